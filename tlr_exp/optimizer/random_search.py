"""Random search: the evaluations of a search, spent on uniform draws.

A search whose result is no better than this one's has not learned from what it evaluated.
"""

from collections.abc import Callable
from dataclasses import dataclass

import torch
from torch import Tensor

from tlr_exp.config.checks import check_at_least
from tlr_exp.optimizer.base import ChosenWeights
from tlr_exp.optimizer.search import SearchResult, SearchTask, Tally, TieBreak
from tlr_exp.reward.objectives import WeightFunction

_AT_ONCE = 30  # positions per call of the function: the memory that a pack of wolves needs


def random_search(
    objective_fn: Callable[[Tensor], Tensor], task: SearchTask, budget: int
) -> SearchResult:
    """The best of `budget` positions drawn uniformly from the box; all of them are the pack.

    Raises:
        UserError: a value is not a number.
    """
    tally = Tally(objective_fn, task)
    pack = task.uniform(budget)
    values = torch.cat([tally(part) for part in pack.split(_AT_ONCE)])
    return tally.result(pack, values)


@dataclass(kw_only=True, eq=False)
class RandomSearch(ChosenWeights):
    """The best of `budget` uniform weight vectors, drawn anew in every iteration."""

    budget: int
    lower: float
    upper: float
    tie_break: TieBreak

    def __post_init__(self) -> None:
        super().__post_init__()
        self.set_box(self.lower, self.upper, self.tie_break)
        check_at_least("budget", self.budget, 1)

    def search(self, objective_fn: WeightFunction) -> SearchResult:
        """One random search."""
        return random_search(objective_fn, self.task, self.budget)
