"""Weights that a curriculum sets stage by stage; the stages are those of the training."""

import math
from dataclasses import dataclass

import torch
from torch import Tensor

from tlr_exp.optimizer.around import Reweighted
from tlr_exp.optimizer.protocol import TrainingProgress


@dataclass(kw_only=True, eq=False)
class StagedWeights(Reweighted):
    """The weights that the present stage gives; terms that it does not name have those of `inner`.

    Attributes:
        given: the weights of the present stage, NaN for terms without one [num_terms].
    """

    def __post_init__(self) -> None:
        super().__post_init__()
        self.given = torch.full((self.num_terms,), math.nan, device=self.device)

    def observe(self, progress: TrainingProgress) -> None:
        """Take the weights of the stage that the training is in."""
        super().observe(progress)
        if progress.stage_weights:
            given = [progress.stage_weights.get(name, math.nan) for name in progress.mean_terms]
            self.given = torch.tensor(given, device=self.device)
        else:
            self.given = torch.full_like(self.given, math.nan)

    def changed(self, weights: Tensor) -> Tensor:
        """The stage's weights where there are some."""
        return torch.where(self.given.isnan(), weights, self.given)
