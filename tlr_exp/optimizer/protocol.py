"""What the training loop knows of a weight optimizer, and nothing more."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Protocol

from torch import Tensor


@dataclass(frozen=True)
class WeightUpdate:
    """The weights of one iteration and how they were found.

    Attributes:
        weights: weights of the optimizing terms [num_terms], float32, on the device of the
            returns they were found from.
        objective: J at `weights`.
        baseline_objective: J at weights that are all 1, the static reward.
        evaluations: weight vectors whose J was computed in order to choose `weights`; 0 where
            the choice does not depend on J.
        optimal_share: share of the last pack whose J equals the best J found; 1.0 for an
            optimizer without a pack. Near 1, the tie-break decides which weights are returned.
    """

    weights: Tensor
    objective: float
    baseline_objective: float
    evaluations: int
    optimal_share: float


@dataclass(frozen=True)
class TrainingProgress:
    """How far a training is when the weights of an iteration are chosen.

    Attributes:
        mean_episode_length: mean over the last finished episodes, control steps, those included
            that ended in the batch of this iteration.
        num_steps: control steps of each environment in this batch.
        mean_terms: mean raw value of each optimizing term in this batch, in its own unit; in the
            order of the weights.
        goal_share: mean goal reward of a step in this batch, as a share of perfect tracking's.
        stage_weights: weights of terms that the present stage of a curriculum sets, by name.
    """

    mean_episode_length: float
    num_steps: int
    mean_terms: Mapping[str, float] = field(default_factory=dict)
    goal_share: float = math.nan
    stage_weights: Mapping[str, float] = field(default_factory=dict)


class WeightOptimizer(Protocol):
    """Chooses the weights of the optimizing terms, once per training iteration."""

    def observe(self, progress: TrainingProgress) -> None:
        """Learn how the training goes; called once before every `update`."""
        ...

    def update(self, goal_return: Tensor, term_returns: Tensor) -> WeightUpdate:
        """Choose the weights for the trajectories of one iteration.

        Args:
            goal_return: r_g of each trajectory [num_envs].
            term_returns: signed return of each optimizing term at weight 1
                [num_envs, num_terms].
        """
        ...

    def state_dict(self) -> dict[str, Any]:
        """Everything that the next `update` depends on besides its arguments (tensors)."""
        ...

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Continue, bit for bit, from where `state_dict` was taken."""
        ...
