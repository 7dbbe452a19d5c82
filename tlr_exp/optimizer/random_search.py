"""Random search: the evaluations of a search, spent on uniform draws.

A search whose result is no better than this one's has not learned from what it evaluated.
"""

from collections.abc import Callable

import torch
from torch import Tensor

from tlr_exp.optimizer.base import SearchResult
from tlr_exp.optimizer.box import uniform_positions
from tlr_exp.optimizer.pack import BudgetSearch, Tally, TieBreak
from tlr_exp.reward.objectives import WeightFunction

_AT_ONCE = 30  # positions per call of the function: the memory that a pack of wolves needs


def random_search(
    objective_fn: Callable[[Tensor], Tensor],
    lower: Tensor,
    upper: Tensor,
    budget: int,
    generator: torch.Generator,
    tie_break: TieBreak = "first",
) -> SearchResult:
    """The best of `budget` positions drawn uniformly from the box; all of them are the pack.

    Raises:
        ValueError: a value is not a number.
    """
    tally = Tally(objective_fn, lower, upper, tie_break)
    pack = uniform_positions(lower, upper, budget, generator)
    values = torch.cat([tally(part) for part in pack.split(_AT_ONCE)])
    return tally.result(pack, values)


class RandomSearch(BudgetSearch):
    """The best of `budget` uniform weight vectors, drawn anew in every iteration."""

    def search(self, objective_fn: WeightFunction) -> SearchResult:
        """One random search with the settings of this optimizer."""
        return random_search(
            objective_fn, self.lower, self.upper, self.budget, self.generator, self.tie_break
        )
