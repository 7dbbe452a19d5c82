"""A weight optimizer that waits until the goal is achieved well enough.

The paper's section 3.1 says of the lower layer that it is "activated only when this primary goal is
sufficiently achieved", which its Algorithm 1 does not do. This is that sentence, read as a gate
around any optimizer.
"""

from dataclasses import dataclass

import torch
from torch import Tensor

from tlr_exp.config.checks import check_within
from tlr_exp.optimizer.around import Around
from tlr_exp.optimizer.protocol import TrainingProgress, WeightUpdate
from tlr_exp.optimizer.search import SearchResult, unsearched
from tlr_exp.reward.objectives import WeightFunction


@dataclass(kw_only=True, eq=False)
class WhenTracking(Around):
    """Weights `before` until the goal reward is a share of its largest, then those of `inner`.

    The share is that of one iteration, under exploration noise: the goal reward of a step over that
    of perfect tracking. `inner` learns how the training goes from the first iteration on, and its J
    is computed at the weights `before`, too, to be recorded.

    Attributes:
        threshold: the share, from 0 to 1; 0 is `inner` alone.
        before: the value of every weight until then: 1 the static reward, 0 no lower layer.
        stays: whether the gate, once open, stays open.
        is_open: whether it is now, a bool tensor.
    """

    threshold: float
    before: float
    stays: bool

    def __post_init__(self) -> None:
        super().__post_init__()
        check_within("threshold", self.threshold, 0.0, 1.0)
        check_within("before", self.before, 0.0, 1.0)
        self.is_open = torch.tensor(False)
        self.saved = ("is_open",)

    def observe(self, progress: TrainingProgress) -> None:
        """Open or close the gate by the goal reward of this iteration."""
        reached = progress.goal_share >= self.threshold
        self.is_open = torch.tensor(reached or (self.stays and bool(self.is_open)))
        super().observe(progress)

    def update(self, goal_return: Tensor, term_returns: Tensor) -> WeightUpdate:
        """The weights of `inner` where the gate is open; see `WeightOptimizer.update`."""
        chooser = self.parts["inner"] if self.is_open else super()
        return chooser.update(goal_return, term_returns)

    def search(self, objective_fn: WeightFunction) -> SearchResult:
        """The weights before the gate opens, whatever their J."""
        weights = torch.full((self.num_terms,), float(self.before), device=self.device)
        return unsearched(weights, objective_fn)
