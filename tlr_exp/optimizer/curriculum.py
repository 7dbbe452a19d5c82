"""ASAP's penalty curriculum: one weight for all penalties, which grows while the robot stays up.

The control for an effect of smaller penalties alone: they begin small, and J has no say.
"""

from typing import Any

import torch

from tlr_exp.optimizer.base import (
    SearchOptimizer,
    SearchResult,
    check_integer,
    check_number,
    check_state_names,
    unsearched,
)
from tlr_exp.optimizer.protocol import TrainingProgress
from tlr_exp.reward.objectives import Objective, WeightFunction


class PenaltyCurriculum(SearchOptimizer):
    """Weights that are all equal to a scale, which follows the mean length of the episodes.

    In every control step the scale is multiplied by 1 + rate while the mean episode is longer than
    `grow_above_steps`, by 1 - rate while it is shorter than `shrink_below_steps`, and kept within
    [0, largest]. The values are those of ASAP. It takes the mean length anew in every control
    step, over about the last 10 000 episodes; here it is that of the last 100, taken once per
    iteration, and the steps of the iteration are made together.

    Args:
        num_terms: number of optimizing terms; 0 where the reward has a goal part alone.
        objective: the function whose value is recorded.
        seed: not used: nothing here is random.
        device: where J is computed.
        initial: the scale at first, from 0 to `largest`.
        largest: the scale that is not exceeded.
        rate: share by which the scale changes in one control step.
        grow_above_steps: it grows while the mean episode is longer than this, control steps.
        shrink_below_steps: it shrinks while the mean episode is shorter than this.

    Raises:
        ValueError: a setting outside its range.
    """

    def __init__(
        self,
        num_terms: int,
        objective: Objective,
        seed: int = 0,
        device: str | torch.device = "cpu",
        *,
        initial: float = 0.1,
        largest: float = 1.0,
        rate: float = 1e-5,
        grow_above_steps: float = 42.0,
        shrink_below_steps: float = 40.0,
    ) -> None:
        check_integer("num_terms", num_terms, 0)
        check_number("largest", largest, 0.0, float("inf"))
        check_number("initial", initial, 0.0, largest)
        check_number("rate", rate, 0.0, 1.0)
        if not shrink_below_steps <= grow_above_steps:
            raise ValueError(
                f"shrink_below_steps {shrink_below_steps!r} exceeds grow_above_steps "
                f"{grow_above_steps!r}: between them the scale would have to do both"
            )
        super().__init__(num_terms, objective, device)
        self.scale = float(initial)
        self.largest = largest
        self.rate = rate
        self.grow_above_steps = grow_above_steps
        self.shrink_below_steps = shrink_below_steps

    def observe(self, progress: TrainingProgress) -> None:
        """Move the scale by the control steps of one iteration."""
        factor = 1.0
        if progress.mean_episode_length > self.grow_above_steps:
            factor = 1.0 + self.rate
        elif progress.mean_episode_length < self.shrink_below_steps:
            factor = 1.0 - self.rate
        self.scale = min(self.scale * factor**progress.num_steps, self.largest)

    def search(self, objective_fn: WeightFunction) -> SearchResult:
        """The scale as every weight, whatever its J."""
        weights = torch.full((self.num_terms,), self.scale, device=self.device)
        return unsearched(weights, objective_fn)

    def state_dict(self) -> dict[str, Any]:
        """The scale (a float64 scalar)."""
        return {"scale": torch.tensor(self.scale, dtype=torch.float64)}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Continue, bit for bit, from where `state_dict` was taken.

        Raises:
            ValueError: the state of another kind of optimizer.
        """
        check_state_names(state, {"scale"})
        self.scale = state["scale"].item()
