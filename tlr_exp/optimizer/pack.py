"""What searches over positions share: ties, the tally of evaluations, their common settings.

J has wide plateaus at 0, so that many positions are equally good. Every search here therefore has a
stated tie-break, which decides among equal values alone:

- `first`: the position found first stays ahead, as the paper's algorithm is printed;
- `largest_norm`: the one with the largest Euclidean norm, the most shaping; of these the first.
"""

from abc import abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal, get_args

import torch
from torch import Tensor

from tlr_exp.config.limits import check_choice
from tlr_exp.optimizer.base import SearchResult, check_flag, check_integer
from tlr_exp.optimizer.box import BoxOptimizer, uniform_positions
from tlr_exp.reward.objectives import WeightFunction

TieBreak = Literal["first", "largest_norm"]


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


class BudgetSpent(Exception):
    """No evaluation is left. It ends a search and is no error."""


class Tally:
    """Evaluates positions for a search, counts them, and keeps the best.

    Args:
        objective_fn: positions [n, dims] -> values [n].
        lower: lower bounds [dims]. Its device and dtype are those of the positions.
        upper: upper bounds [dims].
        tie_break: which of equally good positions is the best.
        budget: evaluations that may be made; None: any number.
    """

    def __init__(
        self,
        objective_fn: Callable[[Tensor], Tensor],
        lower: Tensor,
        upper: Tensor,
        tie_break: TieBreak = "first",
        budget: int | None = None,
    ) -> None:
        self.objective_fn, self.lower, self.upper = objective_fn, lower, upper
        self.tie_break: TieBreak = tie_break
        self.budget = budget
        self.evaluations = 0
        self.best = lower.new_empty(0, len(lower))  # [1, dims] once something was evaluated
        self.best_value = lower.new_empty(0)

    def __call__(self, positions: Tensor) -> Tensor:
        """Values [n] of positions [n, dims], which are clipped to the box.

        Raises:
            BudgetSpent: the budget ended; what was left of it went to the first positions.
            ValueError: a value is not a number: it would lead or hide the others.
        """
        left = len(positions) if self.budget is None else self.budget - self.evaluations
        within = positions[:left].to(self.lower).clamp(self.lower, self.upper)
        if len(within):
            values = self.objective_fn(within)
            if values.isnan().any():
                bad = within[values.isnan()][0].tolist()
                raise ValueError(f"the objective is not a number at the weights {bad}")
            self._note(within, values)
        if len(within) < len(positions):
            raise BudgetSpent
        return values

    def _note(self, positions: Tensor, values: Tensor) -> None:
        self.evaluations += len(positions)
        positions = torch.cat([self.best, positions])
        values = torch.cat([self.best_value.to(values), values])
        best = best_first(positions, values, self.tie_break)[:1]
        self.best, self.best_value = positions[best], values[best]

    def result(self, pack: Tensor, pack_values: Tensor) -> SearchResult:
        """What was found; `pack` [pack, dims] and its values [pack] are the last ones."""
        return SearchResult(
            position=self.best[0].clone(),
            value=self.best_value.item(),
            pack=pack,
            pack_values=pack_values,
            evaluations=self.evaluations,
        )


@dataclass(frozen=True)
class PackSearch:
    """What every search of a pack is told: where to look, how long, and by which random numbers.

    It evaluates its pack once at the start and after each of its moves, `pack_size` *
    (`iterations` + 1) positions in all.

    Attributes:
        lower: lower bounds [dims]. Its device and dtype are those of the positions.
        upper: upper bounds [dims].
        pack_size: number of positions in the pack.
        iterations: number of moves of the pack, at least 1.
        generator: source of all random numbers, on the device of `lower`.
        tie_break: which of equally good positions wins.
        start: positions [n, dims] that replace the first n of the random pack.
    """

    lower: Tensor
    upper: Tensor
    pack_size: int
    iterations: int
    generator: torch.Generator
    tie_break: TieBreak = "first"
    start: Tensor | None = None

    def tally(self, objective_fn: Callable[[Tensor], Tensor]) -> Tally:
        """A new tally of the function over this box."""
        return Tally(objective_fn, self.lower, self.upper, self.tie_break)

    def first_pack(self) -> Tensor:
        """A random pack [pack_size, dims], whose first positions are `start`, clipped."""
        pack = uniform_positions(self.lower, self.upper, self.pack_size, self.generator)
        if self.start is not None:
            pack[: len(self.start)] = self.start.to(pack).clamp(self.lower, self.upper)
        return pack


class WeightSearch(BoxOptimizer):
    """A `BoxOptimizer` that looks for small J with a known number of evaluations.

    Args:
        tie_break: which of equally good weights win.
        Others: see `BoxOptimizer`.

    Raises:
        ValueError: a setting outside its range.
    """

    def __init__(
        self,
        *arguments: Any,
        tie_break: TieBreak = "first",
        **settings: Any,
    ) -> None:
        super().__init__(*arguments, **settings)
        check_choice("tie_break", tie_break, get_args(TieBreak))
        self.tie_break: TieBreak = tie_break

    @abstractmethod
    def fit_budget(self, evaluations: int) -> None:
        """Make every further search take at most this many evaluations.

        Raises:
            ValueError: too few for this algorithm with its settings.
        """


class BudgetSearch(WeightSearch):
    """A `WeightSearch` that is given the number of evaluations.

    Args:
        budget: evaluations of J per training iteration; by default those of the grey wolf search,
            30 + 30 * 50.
        Others: see `WeightSearch`.
    """

    def __init__(
        self,
        *arguments: Any,
        budget: int = 1530,
        **settings: Any,
    ) -> None:
        super().__init__(*arguments, **settings)
        self.fit_budget(budget)

    def fit_budget(self, evaluations: int) -> None:
        """See `WeightSearch.fit_budget`."""
        check_integer("budget", evaluations, 1)
        self.budget = evaluations


class PackOptimizer(WeightSearch):
    """A `WeightSearch` by an `algorithm` that moves a pack, see `PackSearch`.

    Args:
        pack_size: number of positions in the pack.
        iterations: number of moves of the pack per training iteration, at least 1.
        warm_start: the search starts with the last iteration's weights in its pack; in the first
            iteration with weights 1, clipped to the box.
        Others: see `WeightSearch`.

    Attributes:
        algorithm: the search with its own settings, which a subclass gives.
    """

    algorithm: Callable[[WeightFunction, PackSearch], SearchResult]
    min_pack_size = 1
    why_min_pack_size = ""

    def __init__(
        self,
        *arguments: Any,
        pack_size: int = 30,
        iterations: int = 50,
        warm_start: bool = False,
        **settings: Any,
    ) -> None:
        super().__init__(*arguments, **settings)
        check_integer("pack_size", pack_size, self.min_pack_size, self.why_min_pack_size)
        check_integer("iterations", iterations, 1)
        check_flag("warm_start", warm_start)
        self.pack_size = pack_size
        self.iterations = iterations
        self.warm_start = warm_start

    def fit_budget(self, evaluations: int) -> None:
        """See `WeightSearch.fit_budget`: the pack stays, it moves fewer or more times."""
        moves = evaluations // self.pack_size - 1
        if moves < 1:
            raise ValueError(
                f"a budget of {evaluations} evaluations is less than a pack of {self.pack_size} "
                "and one move of it: use a larger budget or a smaller pack_size"
            )
        self.iterations = moves

    def search(self, objective_fn: WeightFunction) -> SearchResult:
        """One search by `algorithm` with the settings of this optimizer."""
        task = PackSearch(
            self.lower,
            self.upper,
            self.pack_size,
            self.iterations,
            self.generator,
            self.tie_break,
            self.start(),
        )
        return self.algorithm(objective_fn, task)

    def start(self) -> Tensor | None:
        """Positions [n, num_terms] that a warm start puts into the first pack."""
        return self.last_weights[None] if self.warm_start else None
