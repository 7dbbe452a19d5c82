"""What all weight optimizers of this room share: from returns to weights, and what is saved."""

import math
from abc import ABC, abstractmethod
from collections.abc import Collection
from dataclasses import dataclass, replace
from typing import Any, get_args

import torch
from torch import Tensor

from tlr_exp.config.checks import check_at_least, check_choice
from tlr_exp.errors import UserError
from tlr_exp.optimizer.protocol import TrainingProgress, WeightUpdate
from tlr_exp.optimizer.search import SearchResult, SearchTask, TieBreak
from tlr_exp.reward.objectives import Objective, WeightFunction


@dataclass(kw_only=True, eq=False)
class ChosenWeights(ABC):
    """A `WeightOptimizer` that chooses by `search`, and goes on from what its attributes hold.

    An optimizer is a dataclass on top of this one. Its fields are the settings of its file in
    `conf/optimizer`, where their values stand; here are those that the training gives besides.
    `__post_init__` checks them and raises a `UserError` for one outside its range. Settings of
    the same name mean the same in all of them:

    - lower, upper: smallest and largest weight;
    - tie_break: which of equally good weights win, see `search.py`;
    - budget: evaluations of J per training iteration, at least 1;
    - pack_size, iterations: positions that move together, and how often they move in a training
      iteration, at least once. They are evaluated at the start and after every move;
    - warm_start: the search begins at the last iteration's weights; in the first iteration at
      weights 1, clipped to the box.

    Attributes:
        num_terms: number of optimizing terms; 0 where the reward has a goal part alone.
        objective: the function to minimise or to record, prepared anew in every iteration.
        seed: of this optimizer's own random numbers, if it has any.
        device: where the search runs. The tensors are small: on most machines "cpu" is best.
        saved: names of the attributes (tensors and generators) on which the next `update` depends.
        last_weights: those of the last `update` [num_terms].
    """

    num_terms: int
    objective: Objective
    seed: int
    device: str | torch.device

    def __post_init__(self) -> None:
        check_at_least("num_terms", self.num_terms, 0)
        check_at_least("seed", self.seed, 0)
        self.saved: tuple[str, ...] = ()
        # Before the first iteration the reward is the static one: every weight 1.
        self.last_weights = torch.ones(self.num_terms, device=self.device)

    def set_box(self, lower: float, upper: float, tie_break: TieBreak) -> None:
        """Prepare `task`, a search of [lower, upper]^num_terms, whose generator is saved.

        Raises:
            UserError: no terms, not a box, or no such tie-break.
        """
        if self.num_terms == 0:
            raise UserError("num_terms is 0: the reward has no optimizing terms to weigh")
        if not -math.inf < lower < upper < math.inf:
            raise UserError(
                f"lower {lower!r} and upper {upper!r} must be finite with lower < upper "
                "(the paper: 0 and 1)"
            )
        check_choice("tie_break", tie_break, get_args(TieBreak))
        self.generator = torch.Generator(self.device).manual_seed(self.seed)
        self.task = SearchTask(
            lower=torch.full((self.num_terms,), float(lower), device=self.device),
            upper=torch.full((self.num_terms,), float(upper), device=self.device),
            generator=self.generator,
            tie_break=tie_break,
        )
        self.last_weights = self.last_weights.clamp(self.task.lower, self.task.upper)
        self.saved = ("generator", "last_weights")

    def warm_task(self, warm_start: bool) -> SearchTask:
        """`task`, on demand with a start at the last weights."""
        return replace(self.task, start=self.last_weights[None]) if warm_start else self.task

    def observe(self, progress: TrainingProgress) -> None:  # noqa: B027 - most need not know
        """Learn how the training goes, before an `update`. A search over J needs nothing of it."""

    @abstractmethod
    def search(self, objective_fn: WeightFunction) -> SearchResult:
        """Choose weights. `objective_fn` maps weights [pack, num_terms] to J [pack]."""

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
            raise UserError(
                f"term_returns have shape {tuple(term_returns.shape)}, expected "
                f"[num_envs, {self.num_terms}]: this optimizer was made for {self.num_terms} terms"
            )
        objective_fn = self.objective.prepare(
            goal_return.to(self.device), term_returns.to(self.device)
        )
        result = self.search(objective_fn)
        static_weights = torch.ones(1, self.num_terms, device=self.device)
        self.last_weights = result.position.clone()
        return WeightUpdate(
            weights=result.position.to(goal_return.device),
            objective=result.value,
            baseline_objective=objective_fn(static_weights).item(),
            evaluations=result.evaluations,
            optimal_share=result.optimal_share,
            details=result.details,
        )

    def state_dict(self) -> dict[str, Any]:
        """The attributes that `saved` names; of a generator its state (uint8, on the CPU)."""
        values = {name: getattr(self, name) for name in self.saved}
        return {
            name: value.get_state() if isinstance(value, torch.Generator) else value.clone()
            for name, value in values.items()
        }

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Continue, bit for bit, from where `state_dict` was taken.

        Raises:
            UserError: missing or unknown entries, or those for another number of terms.
        """
        check_state_names(state, self.saved)
        for name, saved in state.items():
            value = getattr(self, name)
            if isinstance(value, torch.Generator):
                value.set_state(saved.cpu())
                continue
            if saved.shape[-1:] != value.shape[-1:]:
                raise UserError(
                    f"the saved {name} has shape {tuple(saved.shape)}, this one has "
                    f"{self.num_terms} terms: resume with the reward terms it was saved with"
                )
            setattr(self, name, saved.to(value, copy=True))


def check_state_names(names: Collection[str], expected: Collection[str]) -> None:
    """Refuse the saved state of another kind of optimizer."""
    if set(names) != set(expected):
        raise UserError(
            f"the saved optimizer state has the entries {sorted(names)}, expected "
            f"{sorted(expected)}: it was saved by another kind of optimizer"
        )
