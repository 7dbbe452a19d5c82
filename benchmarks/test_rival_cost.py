"""What each way of weighing the lower layer costs an iteration, as a ratio to the static reward's.

At the paper's size (4096 trajectories of 24 steps, its networks and recipe), on one thread:

    pytest benchmarks/test_rival_cost.py

A static iteration is made once, with all that belongs to it. For every choice the iteration is then
repeated on that batch without learning; what it takes beyond the same with static weights is what
the choice costs. Times are those of the processor, so that other work on the machine counts little.
`when_tracking` is measured with its gate open.
"""

import statistics
import time
from collections.abc import Callable
from dataclasses import dataclass
from types import SimpleNamespace

import pytest
import torch
from hydra import compose, initialize_config_module
from pytest_benchmark.fixture import BenchmarkFixture

from benchmarks.optimizers.searches import configured
from tlr_exp.assembly.environment import build_env
from tlr_exp.assembly.learner import build_ppo
from tlr_exp.assembly.terms import terms_of_training
from tlr_exp.assembly.world import build_clip, build_robot_of
from tlr_exp.config.load import load_settings
from tlr_exp.ppo.learner import PpoDiagnostics
from tlr_exp.reward.objectives import RankDeviation
from tlr_exp.training.build import build_trainer
from tlr_exp.training.iteration import Trainer

NUM_ENVS = 4096
ROUNDS = 3
CHOICES = {
    **{"zero": {}, "random": {}, "curriculum": {}, "lagrangian": {}, "gwo": {}, "cma_es": {}},
    "when_tracking": {"threshold": 0.0},
    **{"gradnorm": {}, "pcgrad": {}, "meta_gradient": {}},
}
LARGEST_RATIO = 2.0  # of no rival should an iteration take twice as long


@dataclass(frozen=True)
class Static:
    """An iteration of the static reward that has been made.

    Attributes:
        trainer: on the batch of that iteration, and with a learner that does not learn.
        seconds: that the iteration took.
        bare_s: the same without collecting and learning.
    """

    trainer: Trainer
    seconds: float
    bare_s: float


@pytest.fixture(scope="module")
def static():
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    trainer = trainer_at(NUM_ENVS)
    batches = kept(trainer)
    seconds = processor_s(trainer)
    trainer.collect = batches[0].copy  # type: ignore[method-assign]
    trainer.ppo = SimpleNamespace(  # type: ignore[assignment]
        estimate_advantages=lambda batch: None,
        update=lambda batch, progress: PpoDiagnostics(*[0.0] * 8),
        policy_gradients=trainer.ppo.policy_gradients,
    )
    yield Static(trainer, seconds, statistics.median(processor_s(trainer) for _ in range(ROUNDS)))
    torch.set_num_threads(threads)


def processor_s(trainer: Trainer) -> float:
    """Seconds of the processor that an iteration takes."""
    start = time.process_time()
    trainer.train_iteration()
    return time.process_time() - start


def trainer_at(num_envs: int) -> Trainer:
    """A training of the static reward on one thread."""
    overrides = ["scale=paper", f"scale.num_envs={num_envs}", "physics.num_threads=1"]
    with initialize_config_module("tlr_exp.conf", version_base="1.3"):
        settings = load_settings(compose("config", [*overrides, "precision=float32"]))
    robot = build_robot_of(settings.env)
    clip = build_clip(settings.env, robot)
    env = build_env(settings, robot, clip, terms_of_training(settings))
    objective = RankDeviation(0.1)
    optimizer = configured("fixed", len(settings.reward.optimizing), objective, seed=0)
    return build_trainer(settings, env, build_ppo(settings), objective, optimizer)


def kept(trainer: Trainer) -> list:
    """A list that gets the batches which the trainer collects."""
    batches: list = []
    collect: Callable = trainer.collect

    def collect_and_keep():
        batch = collect()
        batches.append(batch.copy())  # without what the iteration adds to it
        return batch

    trainer.collect = collect_and_keep  # type: ignore[method-assign]
    return batches


@pytest.mark.parametrize("choice", CHOICES)
def test_cost_of_an_iteration(choice: str, static: Static, benchmark: BenchmarkFixture) -> None:
    trainer, num_terms = static.trainer, len(static.trainer.split.optimizing_names)
    settings, seconds = CHOICES[choice], []

    def find_weights() -> None:
        trainer.weight_optimizer = configured(
            choice, num_terms, RankDeviation(0.1), seed=0, **settings
        )
        seconds.append(processor_s(trainer))

    benchmark.pedantic(find_weights, rounds=ROUNDS, warmup_rounds=1)
    added_s = statistics.median(seconds[1:]) - static.bare_s
    ratio = 1.0 + added_s / static.seconds
    benchmark.extra_info["static_iteration_s"] = static.seconds
    benchmark.extra_info["ratio_to_a_static_iteration"] = ratio
    print(f"\n{choice}: {ratio:.3f} of a static iteration of {static.seconds:.1f} s")
    assert ratio <= LARGEST_RATIO
