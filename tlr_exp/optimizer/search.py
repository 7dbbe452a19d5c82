"""What every search over positions shares: its task, the tie-break, the tally, the result.

J has wide plateaus at 0, so that many positions are equally good. Every search here therefore has a
stated tie-break, which decides among equal values alone:

- `first`: the position found first stays ahead, as the paper's algorithm is printed;
- `largest_norm`: the one with the largest Euclidean norm, the most shaping; of these the first.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Literal

import torch
from torch import Tensor

from tlr_exp.errors import UserError

TieBreak = Literal["first", "largest_norm"]


@dataclass(frozen=True, kw_only=True)
class SearchTask:
    """What every search is told: where to look, by which random numbers, and which equals win.

    Attributes:
        lower: lower bounds [dims]. Its device and dtype are those of the positions.
        upper: upper bounds [dims].
        generator: source of all random numbers, on the device of `lower`.
        tie_break: which of equally good positions wins.
        start: positions [n, dims] from which the search begins, as far as it has a use for them.
    """

    lower: Tensor
    upper: Tensor
    generator: torch.Generator
    tie_break: TieBreak = "first"
    start: Tensor | None = None

    def uniform(self, count: int) -> Tensor:
        """Positions drawn uniformly from the box [count, dims]."""
        lower, upper = self.lower, self.upper
        shape = count, len(lower)
        unit = torch.rand(shape, generator=self.generator, device=lower.device, dtype=lower.dtype)
        # Rounding could leave the box by the last bit.
        return (lower + (upper - lower) * unit).clamp(lower, upper)

    def first_pack(self, pack_size: int) -> Tensor:
        """A random pack [pack_size, dims], whose first positions are `start`, clipped."""
        pack = self.uniform(pack_size)
        if self.start is not None:
            pack[: len(self.start)] = self.start.to(pack).clamp(self.lower, self.upper)
        return pack


@dataclass(frozen=True)
class SearchResult:
    """What a minimiser found.

    Attributes:
        position: the best position [dims].
        value: the function at `position`.
        pack: the last pack of positions [pack, dims].
        pack_values: the function at these positions [pack].
        evaluations: positions at which the function was computed in order to choose.
        details: numbers of the search's own, by name, to be recorded.
    """

    position: Tensor
    value: float
    pack: Tensor
    pack_values: Tensor
    evaluations: int
    details: Mapping[str, float] = field(default_factory=dict)

    @property
    def optimal_share(self) -> float:
        """Share of the last pack whose value equals the best value found."""
        return (self.pack_values == self.value).double().mean().item()


def unsearched(
    weights: Tensor,
    objective_fn: Callable[[Tensor], Tensor],
    details: Mapping[str, float] | None = None,
) -> SearchResult:
    """The result where weights [num_terms] are chosen without a look at J, which is recorded."""
    values = objective_fn(weights[None])
    return SearchResult(weights, values.item(), weights[None], values, 0, details or {})


def best_first(positions: Tensor, values: Tensor, tie_break: TieBreak) -> Tensor:
    """Indices [n] that sort positions [n, dims] by value [n]; ties as the tie-break says."""
    if tie_break == "first":
        return values.argsort(stable=True)
    by_norm = positions.norm(dim=1).argsort(descending=True, stable=True)
    return by_norm[values[by_norm].argsort(stable=True)]


def improves(
    positions: Tensor,
    values: Tensor,
    old_positions: Tensor,
    old_values: Tensor,
    tie_break: TieBreak,
) -> Tensor:
    """Where new positions [n, dims] are better than the old ones, row by row [n] bool."""
    better = values < old_values
    if tie_break == "largest_norm":
        more = positions.norm(dim=1) > old_positions.norm(dim=1)
        better |= (values == old_values) & more
    return better


def moves_within(evaluations: int, pack_size: int) -> int:
    """How often a pack can move if it is evaluated once at the start and after each move.

    Raises:
        UserError: not once.
    """
    moves = evaluations // pack_size - 1
    if moves < 1:
        raise UserError(
            f"a budget of {evaluations} evaluations is less than a pack of {pack_size} "
            "and one move of it: use a larger budget or a smaller pack_size"
        )
    return moves


class BudgetSpent(Exception):
    """No evaluation is left. It ends a search and is no error."""


class Tally:
    """Evaluates positions for a search, counts them, and keeps the best.

    Args:
        objective_fn: positions [n, dims] -> values [n].
        task: its box, to which positions are clipped, and its tie-break.
        budget: evaluations that may be made; None: any number.
    """

    def __init__(
        self,
        objective_fn: Callable[[Tensor], Tensor],
        task: SearchTask,
        budget: int | None = None,
    ) -> None:
        self.objective_fn, self.task, self.budget = objective_fn, task, budget
        self.evaluations = 0
        self.best = task.lower.new_empty(0, len(task.lower))  # [1, dims] after an evaluation
        self.best_value = task.lower.new_empty(0)

    def __call__(self, positions: Tensor) -> Tensor:
        """Values [n] of positions [n, dims], which are clipped to the box.

        Raises:
            BudgetSpent: the budget ended; what was left of it went to the first positions.
            UserError: a value is not a number: it would lead or hide the others.
        """
        left = len(positions) if self.budget is None else self.budget - self.evaluations
        within = positions[:left].to(self.task.lower).clamp(self.task.lower, self.task.upper)
        if len(within):
            values = self.objective_fn(within)
            if values.isnan().any():
                bad = within[values.isnan()][0].tolist()
                raise UserError(f"the objective is not a number at the weights {bad}")
            self._note(within, values)
        if len(within) < len(positions):
            raise BudgetSpent
        return values

    def _note(self, positions: Tensor, values: Tensor) -> None:
        self.evaluations += len(positions)
        positions = torch.cat([self.best, positions])
        values = torch.cat([self.best_value.to(values), values])
        best = best_first(positions, values, self.task.tie_break)[:1]
        self.best, self.best_value = positions[best], values[best]

    def result(self, pack: Tensor, pack_values: Tensor) -> SearchResult:
        """What was found; `pack` [pack, dims] and its values [pack] are the last ones."""
        best, value = self.best[0].clone(), self.best_value.item()
        return SearchResult(best, value, pack, pack_values, self.evaluations)
