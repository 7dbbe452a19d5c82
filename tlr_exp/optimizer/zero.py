"""The control without a lower layer: every weight is 0 in every iteration."""

import torch

from tlr_exp.optimizer.base import ChosenWeights
from tlr_exp.optimizer.search import SearchResult, unsearched
from tlr_exp.reward.objectives import WeightFunction


class ZeroWeights(ChosenWeights):
    """Weights that are all 0: the goal reward alone is learned from.

    J is 0 at these weights, whatever the trajectories, so that a search that finds J = 0 has found
    nothing that this control has not.
    """

    def search(self, objective_fn: WeightFunction) -> SearchResult:
        """Weights 0, whatever their J."""
        return unsearched(torch.zeros(self.num_terms, device=self.device), objective_fn)
