"""The static baseline: every weight is 1 in every iteration."""

import torch

from tlr_exp.optimizer.base import ChosenWeights
from tlr_exp.optimizer.search import SearchResult, unsearched
from tlr_exp.reward.objectives import WeightFunction


class FixedWeights(ChosenWeights):
    """Weights that are all 1, the baseline of the paper. J is computed only to be recorded."""

    def search(self, objective_fn: WeightFunction) -> SearchResult:
        """Weights 1, whatever their J."""
        return unsearched(torch.ones(self.num_terms, device=self.device), objective_fn)
