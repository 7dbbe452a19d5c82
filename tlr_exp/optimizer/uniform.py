"""The control: weights drawn uniformly, anew in every iteration, without a look at J.

What an optimizer gains over the static reward could come from the mere change of the weights.
Any claim for an optimizer must therefore beat this one.
"""

from tlr_exp.optimizer.base import SearchResult, unsearched
from tlr_exp.optimizer.box import BoxOptimizer, uniform_positions
from tlr_exp.reward.objectives import WeightFunction


class UniformWeights(BoxOptimizer):
    """Weights drawn from the uniform distribution on [lower, upper]^num_terms."""

    def search(self, objective_fn: WeightFunction) -> SearchResult:
        """One random weight vector; its J is computed only to be recorded."""
        weights = uniform_positions(self.lower, self.upper, 1, self.generator)[0]
        return unsearched(weights, objective_fn)
