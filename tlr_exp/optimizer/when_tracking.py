"""A weight optimizer that waits until the goal is achieved well enough.

The paper's section 3.1 says of the lower layer that it is "activated only when this primary goal is
sufficiently achieved", which its Algorithm 1 does not do. This is that sentence, read as a gate
around any optimizer.
"""

from collections.abc import Callable
from typing import Any

import torch
from torch import Tensor

from tlr_exp.optimizer.base import (
    SearchOptimizer,
    SearchResult,
    check_flag,
    check_number,
    check_state_names,
    unsearched,
)
from tlr_exp.optimizer.protocol import TrainingProgress, WeightOptimizer, WeightUpdate
from tlr_exp.reward.objectives import Objective, WeightFunction

_INNER = "inner."


class WhenTracking(SearchOptimizer):
    """Weights `before` until the goal reward is a share of its largest, then those of `inner`.

    The share is that of one iteration, under exploration noise: the goal reward of a step over that
    of perfect tracking. `inner` learns how the training goes from the first iteration on, and its J
    is computed at the weights `before`, too, to be recorded.

    Args:
        num_terms, objective, seed, device: passed on to `inner`.
        inner: makes the optimizer from these.
        threshold: the share, from 0 to 1; 0 is `inner` alone.
        before: the value of every weight until then: 1 the static reward, 0 no lower layer.
        stays: whether the gate, once open, stays open.

    Raises:
        ValueError: a setting outside its range; or as `inner`.
    """

    def __init__(
        self,
        num_terms: int,
        objective: Objective,
        seed: int,
        device: str | torch.device = "cpu",
        *,
        inner: Callable[..., WeightOptimizer],
        threshold: float = 0.9,
        before: float = 1.0,
        stays: bool = True,
    ) -> None:
        check_number("threshold", threshold, 0.0, 1.0)
        check_number("before", before, 0.0, 1.0)
        check_flag("stays", stays)
        super().__init__(num_terms, objective, device)
        self.inner = inner(num_terms=num_terms, objective=objective, seed=seed, device=device)
        self.threshold, self.before, self.stays = threshold, before, stays
        self.is_open = False

    def observe(self, progress: TrainingProgress) -> None:
        """Open or close the gate by the goal reward of this iteration."""
        reached = progress.goal_share >= self.threshold
        self.is_open = reached or (self.stays and self.is_open)
        self.inner.observe(progress)

    def update(self, goal_return: Tensor, term_returns: Tensor) -> WeightUpdate:
        """The weights of `inner` where the gate is open; see `WeightOptimizer.update`."""
        if self.is_open:
            return self.inner.update(goal_return, term_returns)
        return super().update(goal_return, term_returns)

    def search(self, objective_fn: WeightFunction) -> SearchResult:
        """The weights before the gate opens, whatever their J."""
        weights = torch.full((self.num_terms,), float(self.before), device=self.device)
        return unsearched(weights, objective_fn)

    def state_dict(self) -> dict[str, Any]:
        """Whether the gate is open (a bool tensor), and the state of `inner`."""
        inner = {f"{_INNER}{name}": value for name, value in self.inner.state_dict().items()}
        return {"is_open": torch.tensor(self.is_open), **inner}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Continue, bit for bit, from where `state_dict` was taken.

        Raises:
            ValueError: the state of another kind of optimizer.
        """
        inner = {name: value for name, value in state.items() if name.startswith(_INNER)}
        check_state_names({name: 0 for name in state if name not in inner}, {"is_open"})
        self.inner.load_state_dict(
            {name.removeprefix(_INNER): value for name, value in inner.items()}
        )
        self.is_open = bool(state["is_open"])
