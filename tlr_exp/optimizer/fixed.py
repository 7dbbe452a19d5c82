"""The static baseline: every weight is 1 in every iteration."""

from typing import Any

import torch

from tlr_exp.optimizer.base import (
    SearchOptimizer,
    SearchResult,
    check_integer,
    check_state_names,
    unsearched,
)
from tlr_exp.reward.objectives import Objective, WeightFunction


class FixedWeights(SearchOptimizer):
    """Weights that are all 1, the baseline of the paper. J is computed only to be recorded.

    Args:
        num_terms: number of optimizing terms; 0 where the reward has a goal part alone.
        objective: the function whose value is recorded.
        seed: not used: nothing here is random.
        device: where J is computed.

    Raises:
        ValueError: a negative number of terms.
    """

    def __init__(
        self,
        num_terms: int,
        objective: Objective,
        seed: int = 0,
        device: str | torch.device = "cpu",
    ) -> None:
        check_integer("num_terms", num_terms, 0)
        super().__init__(num_terms, objective, device)

    def search(self, objective_fn: WeightFunction) -> SearchResult:
        """Weights 1, whatever their J."""
        return unsearched(torch.ones(self.num_terms, device=self.device), objective_fn)

    def state_dict(self) -> dict[str, Any]:
        """Empty: no update depends on an earlier one."""
        return {}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Nothing to restore.

        Raises:
            ValueError: the state of another kind of optimizer.
        """
        check_state_names(state, set())
