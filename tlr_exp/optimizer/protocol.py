"""What the training loop knows of a weight optimizer, and nothing more."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Protocol

from torch import Tensor

from tlr_exp.errors import UserError


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
        details: numbers of this optimizer's own, by name, to be recorded with the iteration.
    """

    weights: Tensor
    objective: float
    baseline_objective: float
    evaluations: int
    optimal_share: float
    details: Mapping[str, float] = field(default_factory=dict)


class PolicyGradients(Protocol):
    """How the present policy would have to change for more of each part of the reward.

    Gradients, by the actor's parameters, of the surrogate objectives

        J_k(theta) = mean over steps of pi_theta(a | s) / pi(a | s) * A_k(s, a),

    of the goal reward and of each optimizing term at weight 1, on the batch of this iteration. The
    advantages A_k are linear in the reward, so that the gradient for the reward at weights w is
    goal + w @ terms.
    """

    @property
    def goal(self) -> Tensor:
        """Gradient of the goal's objective at the present policy [num_parameters]."""
        ...

    @property
    def terms(self) -> Tensor:
        """Gradient of each term's objective at the present policy [num_terms, num_parameters]."""
        ...

    def goal_after(self, step: Tensor) -> Tensor:
        """Gradient of the goal's objective where a step [num_parameters] leads to."""
        ...

    def halves(self) -> tuple["PolicyGradients", "PolicyGradients"]:
        """The same of one half of the trajectories and of the other."""
        ...


def no_policy() -> PolicyGradients:
    """What stands for gradients where there is no policy, as in a study of returns alone."""
    raise UserError("this optimizer weighs terms by their policy gradients, and was told of none")


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
        policy_gradients: gives the policy gradients of this batch. They are computed when this is
            called, which must be before the policy learns from the batch: until `update` returns.
    """

    mean_episode_length: float
    num_steps: int
    mean_terms: Mapping[str, float] = field(default_factory=dict)
    goal_share: float = math.nan
    stage_weights: Mapping[str, float] = field(default_factory=dict)
    policy_gradients: Callable[[], PolicyGradients] = field(default=no_policy, compare=False)


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
