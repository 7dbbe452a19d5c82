"""Record the returns of some iterations of a short training: real landscapes of J to search on.

    python -m benchmarks.optimizers.record_landscapes

trains the static arm of the demo scale with 512 environments for 64 iterations (some minutes on two
cores) and writes `landscapes.npz` beside this file. The static arm, because what it collects does
not depend on a search. With the same versions and the same number of threads it writes the same
numbers again.
"""

import json
from pathlib import Path

import numpy as np
import torch
from hydra import compose, initialize_config_module
from numpy.typing import NDArray
from torch import Tensor

from tlr_exp.assembly.environment import build_env
from tlr_exp.assembly.learner import build_ppo
from tlr_exp.assembly.lower_layer import build_lower_layer
from tlr_exp.assembly.terms import terms_of_training
from tlr_exp.assembly.world import build_clip, build_robot_of
from tlr_exp.config.load import CONFIG_PATH, load_settings
from tlr_exp.config.settings import Settings
from tlr_exp.optimizer.protocol import TrainingProgress, WeightOptimizer, WeightUpdate
from tlr_exp.training.build import build_trainer

PATH = Path(__file__).with_name("landscapes.npz")
ITERATIONS = (1, 4, 16, 64)  # the policy learns fastest at first
OVERRIDES = ("optimizer=fixed", "scale.num_envs=512", f"scale.iterations={ITERATIONS[-1]}")


class Recording:
    """A weight optimizer that passes everything on, and keeps the returns it was asked about."""

    def __init__(self, optimizer: WeightOptimizer) -> None:
        self.optimizer = optimizer
        self.returns: tuple[Tensor, Tensor] | None = None

    def observe(self, progress: TrainingProgress) -> None:
        self.optimizer.observe(progress)

    def update(self, goal_return: Tensor, term_returns: Tensor) -> WeightUpdate:
        self.returns = goal_return.clone(), term_returns.clone()
        return self.optimizer.update(goal_return, term_returns)

    def state_dict(self) -> dict:
        return self.optimizer.state_dict()

    def load_state_dict(self, state: dict) -> None:
        self.optimizer.load_state_dict(state)


def settings_of(overrides: tuple[str, ...]) -> Settings:
    """The checked settings of a run of tlr-train with these overrides."""
    with initialize_config_module(CONFIG_PATH.removeprefix("pkg://"), version_base="1.3"):
        return load_settings(compose("config", list(overrides)))


def record(
    settings: Settings, iterations: tuple[int, ...] = ITERATIONS
) -> dict[str, NDArray[np.float32]]:
    """Train, and give the returns of some iterations.

    Returns:
        `goal_return_N` [num_envs] and `term_returns_N` [num_envs, num_terms] of each iteration N.
    """
    robot = build_robot_of(settings.env)
    clip = build_clip(settings.env, robot)
    env = build_env(settings, robot, clip, terms_of_training(settings))
    ppo = build_ppo(settings)
    trainer = build_trainer(settings, env, ppo, *build_lower_layer(settings))
    recording = Recording(trainer.weight_optimizer)
    trainer.weight_optimizer = recording
    found = {}
    for iteration in range(1, max(iterations) + 1):
        metrics = trainer.train_iteration()
        if iteration in iterations:
            assert recording.returns is not None
            goal_return, term_returns = recording.returns
            found[f"goal_return_{iteration}"] = goal_return.numpy()
            found[f"term_returns_{iteration}"] = term_returns.numpy()
            print(f"iteration {iteration}: episodes of {metrics['train/episode_length']:.1f} steps")
    return found


def main() -> None:
    torch.set_num_threads(1)
    settings = settings_of(OVERRIDES)
    recorded = record(settings)
    about = {"overrides": OVERRIDES, "terms": list(settings.reward.optimizing)}
    np.savez_compressed(PATH, about=np.array(json.dumps(about)), **recorded)  # type: ignore[arg-type]
    print(f"{PATH}: {PATH.stat().st_size / 1000:.0f} kB")


if __name__ == "__main__":
    main()
