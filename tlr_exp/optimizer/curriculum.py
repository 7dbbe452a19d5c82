"""ASAP's penalty curriculum: one weight for all penalties, which grows while the robot stays up.

The control for an effect of smaller penalties alone: they begin small, and J has no say.
"""

from dataclasses import dataclass

import torch

from tlr_exp.config.checks import check_above, check_within
from tlr_exp.errors import UserError
from tlr_exp.optimizer.base import ChosenWeights
from tlr_exp.optimizer.protocol import TrainingProgress
from tlr_exp.optimizer.search import SearchResult, unsearched
from tlr_exp.reward.objectives import WeightFunction


@dataclass(kw_only=True, eq=False)
class PenaltyCurriculum(ChosenWeights):
    """Weights that are all equal to a scale, which follows the mean length of the episodes.

    In every control step the scale is multiplied by 1 + rate while the mean episode is longer than
    `grow_above_steps`, by 1 - rate while it is shorter than `shrink_below_steps`, and kept within
    [0, largest]. The values are those of ASAP. It takes the mean length anew in every control
    step, over about the last 10 000 episodes; here it is that of the last 100, taken once per
    iteration, and the steps of the iteration are made together.

    Attributes:
        initial: the scale at first, from 0 to `largest`.
        largest: the scale that is not exceeded, above 0.
        rate: share by which the scale changes in one control step, from 0 to 1.
        grow_above_steps: it grows while the mean episode is longer than this, control steps.
        shrink_below_steps: it shrinks while the mean episode is shorter than this.
        scale: the present one, a float64 scalar.
    """

    initial: float
    largest: float
    rate: float
    grow_above_steps: float
    shrink_below_steps: float

    def __post_init__(self) -> None:
        super().__post_init__()
        check_above("largest", self.largest, 0.0)
        check_within("initial", self.initial, 0.0, self.largest)
        check_within("rate", self.rate, 0.0, 1.0)
        if not self.shrink_below_steps <= self.grow_above_steps:
            raise UserError(
                f"shrink_below_steps {self.shrink_below_steps!r} exceeds grow_above_steps "
                f"{self.grow_above_steps!r}: between them the scale would have to do both"
            )
        self.scale = torch.tensor(self.initial, dtype=torch.float64)
        self.saved = ("scale",)

    def observe(self, progress: TrainingProgress) -> None:
        """Move the scale by the control steps of one iteration."""
        factor = 1.0
        if progress.mean_episode_length > self.grow_above_steps:
            factor = 1.0 + self.rate
        elif progress.mean_episode_length < self.shrink_below_steps:
            factor = 1.0 - self.rate
        self.scale = (self.scale * factor**progress.num_steps).clamp(max=self.largest)

    def search(self, objective_fn: WeightFunction) -> SearchResult:
        """The scale as every weight, whatever its J."""
        weights = torch.full((self.num_terms,), self.scale.item(), device=self.device)
        return unsearched(weights, objective_fn)
