"""One training iteration of the two-layered method, readable as the algorithm.

The trainer knows neither the environment nor which weight optimizer is in use; everything that
surrounds an iteration (run directory, checkpoints, evaluation, display) is in ``loop.py``.
"""

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict
from time import perf_counter

from tensordict import TensorDictBase
from torch import Tensor

from tlr_exp import keys
from tlr_exp.optimizer.protocol import (
    PolicyGradients,
    TrainingProgress,
    WeightOptimizer,
    WeightUpdate,
)
from tlr_exp.ppo.learner import Ppo, PpoDiagnostics
from tlr_exp.reward.box_sample import BoxSample
from tlr_exp.reward.shaping import Shaping
from tlr_exp.reward.split import RewardSplit
from tlr_exp.reward.trajectories import Steps, Trajectories
from tlr_exp.training.episodes import EpisodeLengths, ending_shares, mean_at_equal_ages


class Trainer:
    """Collect, find the weights, compose the reward, estimate advantages, update the policy.

    Args:
        collect: returns a batch [num_envs, num_steps] of the present policy.
        split: the two layers of the reward.
        shaping: the terms that are potentials.
        trajectories: what the weight optimizer ranks.
        weight_optimizer: finds the lower layer's weights of each iteration.
        box_sample: tells how much of the weight box is optimal; it decides nothing.
        ppo: the learner.
        num_envs: number of environments in a batch.
    """

    def __init__(
        self,
        collect: Callable[[], TensorDictBase],
        split: RewardSplit,
        shaping: Shaping,
        trajectories: Trajectories,
        weight_optimizer: WeightOptimizer,
        box_sample: BoxSample,
        ppo: Ppo,
        num_envs: int,
    ) -> None:
        self.collect = collect
        self.split = split
        self.shaping = shaping
        self.trajectories = trajectories
        self.weight_optimizer = weight_optimizer
        self.box_sample = box_sample
        self.ppo = ppo
        self.episodes = EpisodeLengths(num_envs)
        self.env_steps = 0
        self.seconds: dict[str, float] = {}
        self.stage_weights: Mapping[str, float] = {}  # of a curriculum, set from outside

    def train_iteration(self, progress: float = 0.0) -> dict[str, float]:
        """One iteration (Algorithm 1 of the paper around PPO); returns its metrics by name.

        ``progress`` is the share of the training that is behind it, from 0 to 1.

        Raises:
            NonFiniteLossError: the loss is not finite.
        """
        with self._timed("collect"):
            batch = self.collect()
        self.env_steps += batch.numel()
        done = batch["next", keys.DONE].squeeze(-1)
        ages = self.episodes.add(done)
        terms = self._shaped(batch)
        steps = Steps(terms, done, ages, batch["next", keys.PHASE].squeeze(-1))
        returns = self.split.returns(self.trajectories(steps))
        mean_terms = _mean_terms(self.split.term_names, batch["next", keys.REWARD_TERMS])
        with self._timed("weights"):
            self.weight_optimizer.observe(self._progress(batch, terms, mean_terms))
            found = self.weight_optimizer.update(*returns)
        batch["next", keys.REWARD] = self.split.compose(terms, found.weights)
        with self._timed("advantage"):
            self.ppo.estimate_advantages(batch)
        with self._timed("update"):
            diagnostics = self.ppo.update(batch, progress)
        with self._timed("landscape"):
            box_share = self.box_sample.optimal_share(*returns, found.objective)
        learned = self._metrics(batch, mean_terms, found, box_share, diagnostics)
        return {**learned, **_errors_at_equal_ages(batch, ages)}

    def _shaped(self, batch: TensorDictBase) -> Tensor:
        """The raw terms of a batch, in which potentials are differences."""
        terms = batch["next", keys.REWARD_TERMS]
        if not self.shaping.names:
            return terms
        terminated = batch["next", keys.TERMINATED].squeeze(-1)
        return self.shaping(terms, batch[keys.STATE_COSTS], terminated)

    def _progress(
        self, batch: TensorDictBase, terms: Tensor, mean_terms: Mapping[str, float]
    ) -> TrainingProgress:
        """The facts about the training that a weight optimizer may use, apart from the returns."""

        def policy_gradients() -> PolicyGradients:
            rewards = self.split.rewards_apart(terms)
            return self.ppo.policy_gradients(batch, rewards)

        return TrainingProgress(
            mean_episode_length=self.episodes.mean_length,
            num_steps=batch.shape[1],
            mean_terms={name: mean_terms[name] for name in self.split.optimizing_names},
            goal_share=self.split.goal_share(mean_terms),
            stage_weights=self.stage_weights,
            policy_gradients=policy_gradients,
        )

    def _metrics(
        self,
        batch: TensorDictBase,
        mean_terms: Mapping[str, float],
        found: WeightUpdate,
        box_share: float,
        diagnostics: PpoDiagnostics,
    ) -> dict[str, float]:
        after = batch.to_dict()["next"]
        flags = (keys.TERMINATED, keys.TRUNCATED, keys.FELL, keys.UNSTABLE)
        endings = ending_shares(*(after[flag] for flag in flags))
        return {
            keys.ENV_STEPS: self.env_steps,
            keys.EPISODE_LENGTH: self.episodes.mean_length,
            keys.TRAIN_UPPER_BODY_ERROR: after[keys.UPPER_BODY_ERROR].mean().item(),
            keys.TRAIN_LOWER_BODY_ERROR: after[keys.LOWER_BODY_ERROR].mean().item(),
            keys.TRAIN_JOINT_ERROR: after[keys.JOINT_ERROR].mean().item(),
            keys.UNSTABLE_ENVS: after[keys.UNSTABLE].sum().item(),
            **{f"{keys.TRAIN_ENDED_BY}{kind}": share for kind, share in endings.items()},
            keys.OBJECTIVE_BEFORE: found.baseline_objective,
            keys.OBJECTIVE_AFTER: found.objective,
            keys.OPTIMAL_SHARE: found.optimal_share,
            keys.BOX_OPTIMAL_SHARE: box_share,
            keys.STEP_REWARD: after[keys.REWARD].mean().item(),
            **{keys.REWARD_TERM_PREFIX + name: value for name, value in mean_terms.items()},
            **_named(keys.WEIGHT_PREFIX, self.split.optimizing_names, found.weights),
            **{keys.OPTIMIZER_PREFIX + name: value for name, value in found.details.items()},
            **{keys.PPO_PREFIX + name: value for name, value in asdict(diagnostics).items()},
            **{f"{keys.TIME_PREFIX}{name}_s": value for name, value in self.seconds.items()},
        }

    @contextmanager
    def _timed(self, phase: str) -> Iterator[None]:
        start = perf_counter()
        yield
        self.seconds[phase] = perf_counter() - start

    def state_dict(self) -> dict[str, object]:
        """All that the learner needs to go on bit for bit (the simulation is saved apart)."""
        return {
            "ppo": self.ppo.state_dict(),
            "weight_optimizer": self.weight_optimizer.state_dict(),
            "episodes": self.episodes.state_dict(),
            "trajectories": self.trajectories.state_dict(),
            "env_steps": self.env_steps,
        }

    def load_state_dict(self, state: dict) -> None:
        self.ppo.load_state_dict(state["ppo"])
        self.weight_optimizer.load_state_dict(state["weight_optimizer"])
        self.episodes.load_state_dict(state["episodes"])
        if "trajectories" in state:  # runs of earlier versions ranked segments, which keep nothing
            self.trajectories.load_state_dict(state["trajectories"])
        self.env_steps = state["env_steps"]


def _errors_at_equal_ages(batch: TensorDictBase, ages: Tensor) -> dict[str, float]:
    errors = {
        keys.TRAIN_UPPER_BODY_ERROR_AT_EQUAL_AGES: keys.UPPER_BODY_ERROR,
        keys.TRAIN_LOWER_BODY_ERROR_AT_EQUAL_AGES: keys.LOWER_BODY_ERROR,
    }
    return {
        metric: mean_at_equal_ages(batch["next", error].squeeze(-1).cpu(), ages)
        for metric, error in errors.items()
    }


def _mean_terms(names: tuple[str, ...], reward_terms: Tensor) -> dict[str, float]:
    """Mean raw value of each term over the batch."""
    return _named("", names, reward_terms.flatten(0, 1).mean(dim=0))


def _named(prefix: str, names: tuple[str, ...], values: Tensor) -> dict[str, float]:
    return {prefix + name: value for name, value in zip(names, values.tolist(), strict=True)}
