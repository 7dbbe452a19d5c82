"""The control: weights drawn uniformly, anew in every iteration, without a look at J.

What an optimizer gains over the static reward could come from the mere change of the weights.
Any claim for an optimizer must therefore beat this one.
"""

from dataclasses import dataclass

from tlr_exp.optimizer.base import ChosenWeights
from tlr_exp.optimizer.search import SearchResult, unsearched
from tlr_exp.reward.objectives import WeightFunction


@dataclass(kw_only=True, eq=False)
class UniformWeights(ChosenWeights):
    """Weights drawn from the uniform distribution on [lower, upper]^num_terms."""

    lower: float
    upper: float

    def __post_init__(self) -> None:
        super().__post_init__()
        self.set_box(self.lower, self.upper, tie_break="first")

    def search(self, objective_fn: WeightFunction) -> SearchResult:
        """One random weight vector; its J is computed only to be recorded."""
        return unsearched(self.task.uniform(1)[0], objective_fn)
