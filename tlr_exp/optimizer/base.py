"""The part that all weight optimizers share: from returns to a `WeightUpdate`."""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor

from tlr_exp.optimizer.protocol import TrainingProgress, WeightUpdate
from tlr_exp.reward.objectives import Objective, WeightFunction


@dataclass(frozen=True)
class SearchResult:
    """What a minimiser found.

    Attributes:
        position: the best position [dims].
        value: the function at `position`.
        pack: the last pack of positions [pack, dims].
        pack_values: the function at these positions [pack].
        evaluations: positions at which the function was computed in order to choose.
    """

    position: Tensor
    value: float
    pack: Tensor
    pack_values: Tensor
    evaluations: int

    @property
    def optimal_share(self) -> float:
        """Share of the last pack whose value equals the best value found."""
        return (self.pack_values == self.value).double().mean().item()


class SearchOptimizer(ABC):
    """A `WeightOptimizer` that chooses weights by `search`.

    Args:
        num_terms: number of optimizing terms.
        objective: the function to minimise, prepared anew in every iteration.
        device: where the search runs. The tensors are small: on most machines "cpu" is best.
    """

    def __init__(
        self, num_terms: int, objective: Objective, device: str | torch.device = "cpu"
    ) -> None:
        self.num_terms = num_terms
        self.objective = objective
        self.device = torch.device(device)

    def observe(self, progress: TrainingProgress) -> None:  # noqa: B027 - most need not know
        """Learn how the training goes, before an `update`. A search over J needs nothing of it."""

    @abstractmethod
    def search(self, objective_fn: WeightFunction) -> SearchResult:
        """Choose weights. `objective_fn` maps weights [pack, num_terms] to J [pack]."""

    @abstractmethod
    def state_dict(self) -> dict[str, Any]:
        """Everything that the next `update` depends on besides its arguments (tensors)."""

    @abstractmethod
    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Continue, bit for bit, from where `state_dict` was taken."""

    @torch.no_grad()
    def update(self, goal_return: Tensor, term_returns: Tensor) -> WeightUpdate:
        """Choose the weights for the trajectories of one iteration.

        Args:
            goal_return: r_g of each trajectory [num_envs].
            term_returns: signed return of each optimizing term at weight 1
                [num_envs, num_terms].

        Raises:
            ValueError: returns that do not fit `num_terms` or that the objective refuses.
        """
        if term_returns.ndim != 2 or term_returns.shape[1] != self.num_terms:
            raise ValueError(
                f"term_returns have shape {tuple(term_returns.shape)}, expected "
                f"[num_envs, {self.num_terms}]: this optimizer was made for {self.num_terms} terms"
            )
        objective_fn = self.objective.prepare(
            goal_return.to(self.device), term_returns.to(self.device)
        )
        result = self.search(objective_fn)
        static_weights = torch.ones(1, self.num_terms, device=self.device)
        return WeightUpdate(
            weights=result.position.to(goal_return.device),
            objective=result.value,
            baseline_objective=objective_fn(static_weights).item(),
            evaluations=result.evaluations,
            optimal_share=result.optimal_share,
        )


def unsearched(weights: Tensor, objective_fn: WeightFunction) -> SearchResult:
    """The result where weights [num_terms] are chosen without a look at J, which is recorded."""
    values = objective_fn(weights[None])
    return SearchResult(
        position=weights,
        value=values.item(),
        pack=weights[None],
        pack_values=values,
        evaluations=0,
    )


def check_integer(name: str, value: object, minimum: int, reason: str = "") -> None:
    """Refuse anything but a whole number of at least `minimum`."""
    if isinstance(value, bool) or not isinstance(value, int) or value < minimum:
        raise ValueError(
            f"{name} must be a whole number of at least {minimum}, got {value!r}"
            + (f": {reason}" if reason else "")
        )


def check_flag(name: str, value: object) -> None:
    """Refuse anything but true and false."""
    if not isinstance(value, bool):
        raise ValueError(f"{name} must be true or false, got {value!r}")


def check_number(name: str, value: Any, low: float, high: float) -> None:
    """Refuse anything but a number from `low` to `high`."""
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    if not (is_number and low <= value <= high):
        raise ValueError(f"{name} must be a number from {low:g} to {high:g}, got {value!r}")


def check_state_names(state: dict[str, Any], expected: set[str]) -> None:
    """Refuse the saved state of another kind of optimizer."""
    if set(state) != expected:
        raise ValueError(
            f"the saved optimizer state has the entries {sorted(state)}, expected "
            f"{sorted(expected)}: it was saved by another kind of optimizer"
        )
