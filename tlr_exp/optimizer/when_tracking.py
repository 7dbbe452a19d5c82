"""A weight optimizer that waits until the goal is achieved well enough.

The paper's section 3.1 says of the lower layer that it is "activated only when this primary goal is
sufficiently achieved", which its Algorithm 1 does not do. This is that sentence, read as a gate
around any optimizer.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor

from tlr_exp.config.checks import check_within
from tlr_exp.optimizer.base import ChosenWeights, check_state_names
from tlr_exp.optimizer.protocol import TrainingProgress, WeightOptimizer, WeightUpdate
from tlr_exp.optimizer.search import SearchResult, unsearched
from tlr_exp.reward.objectives import WeightFunction

_INNER = "inner."


@dataclass(kw_only=True, eq=False)
class WhenTracking(ChosenWeights):
    """Weights `before` until the goal reward is a share of its largest, then those of `inner`.

    The share is that of one iteration, under exploration noise: the goal reward of a step over that
    of perfect tracking. `inner` learns how the training goes from the first iteration on, and its J
    is computed at the weights `before`, too, to be recorded.

    Attributes:
        inner: makes the optimizer behind the gate from num_terms, objective, seed and device.
        threshold: the share, from 0 to 1; 0 is `inner` alone.
        before: the value of every weight until then: 1 the static reward, 0 no lower layer.
        stays: whether the gate, once open, stays open.
    """

    inner: Callable[..., WeightOptimizer]
    threshold: float
    before: float
    stays: bool

    def __post_init__(self) -> None:
        super().__post_init__()
        check_within("threshold", self.threshold, 0.0, 1.0)
        check_within("before", self.before, 0.0, 1.0)
        self.behind = self.inner(
            num_terms=self.num_terms, objective=self.objective, seed=self.seed, device=self.device
        )
        self.is_open = False

    def observe(self, progress: TrainingProgress) -> None:
        """Open or close the gate by the goal reward of this iteration."""
        reached = progress.goal_share >= self.threshold
        self.is_open = reached or (self.stays and self.is_open)
        self.behind.observe(progress)

    def update(self, goal_return: Tensor, term_returns: Tensor) -> WeightUpdate:
        """The weights of `inner` where the gate is open; see `WeightOptimizer.update`."""
        chooser = self.behind if self.is_open else super()
        return chooser.update(goal_return, term_returns)

    def search(self, objective_fn: WeightFunction) -> SearchResult:
        """The weights before the gate opens, whatever their J."""
        weights = torch.full((self.num_terms,), float(self.before), device=self.device)
        return unsearched(weights, objective_fn)

    def state_dict(self) -> dict[str, Any]:
        """Whether the gate is open (a bool tensor), and the state of `inner`."""
        inner = {f"{_INNER}{name}": value for name, value in self.behind.state_dict().items()}
        return {"is_open": torch.tensor(self.is_open), **inner}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Continue, bit for bit, from where `state_dict` was taken.

        Raises:
            UserError: the state of another kind of optimizer.
        """
        inner = {name: value for name, value in state.items() if name.startswith(_INNER)}
        check_state_names(set(state) - set(inner), {"is_open"})
        self.behind.load_state_dict(
            {name.removeprefix(_INNER): value for name, value in inner.items()}
        )
        self.is_open = bool(state["is_open"])
