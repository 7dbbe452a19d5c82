"""Weights that are averaged over iterations, around any optimizer.

The paper takes the weights of an iteration as its search finds them. Where many weights are equally
good, these jump from one iteration to the next, and the reward with them.
"""

from dataclasses import dataclass

import torch
from torch import Tensor

from tlr_exp.config.checks import check_above, check_within
from tlr_exp.optimizer.around import Reweighted


@dataclass(kw_only=True, eq=False)
class SmoothedWeights(Reweighted):
    """An exponential moving average of the weights that `inner` chooses.

    It begins at the weights 1, the static reward: average <- average + share * (weights - average).
    `inner` does not know of the average: a warm start begins at its own last weights.

    Attributes:
        share: of the new weights in the average, above 0 and up to 1, which is `inner` alone.
        average: the present one [num_terms].
    """

    share: float

    def __post_init__(self) -> None:
        super().__post_init__()
        check_above("share", self.share, 0.0)
        check_within("share", self.share, 0.0, 1.0)
        self.average = torch.ones(self.num_terms, device=self.device)
        self.saved = ("average",)

    def changed(self, weights: Tensor) -> Tensor:
        """The average, with these weights taken in."""
        self.average = torch.lerp(self.average, weights, self.share)
        return self.average
