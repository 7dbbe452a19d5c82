"""A constrained rival of the weight search: each cost of the lower layer has a limit.

The weights are Lagrange multipliers. One rises while its cost is above the limit and falls while it
is below, so that in the end each term weighs as much as its limit needs. J has no say.
"""

import math
from collections.abc import Mapping
from typing import Any

import torch
from torch import Tensor

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


class LagrangianWeights(SearchOptimizer):
    """Weights that hold every cost at its limit, by dual ascent or a PID controller.

    With a cost c (the mean raw value of a term in an iteration), its limit d, and the relative
    excess e = c / d - 1, the multiplier is

        I <- clip(I + integral_gain * e, 0, largest),
        w  = clip(I + proportional_gain * e + derivative_gain * max(0, c - c_before) / d,
                  0, largest).

    Without the last two gains this is dual ascent (projected gradient ascent on the Lagrangian);
    with them the controller of Stooke, Achiam and Abbeel, "Responsive Safety in Reinforcement
    Learning by PID Lagrangian Methods" (2020), Algorithm 2, which overshoots less. Excesses are
    relative so that one gain serves terms of any unit, and I is bounded above, so that it does not
    grow without end where a limit cannot be met. The reward is not divided by 1 + w, as it is
    there: the goal keeps its coefficients, as in every other arm.

    Args:
        num_terms: number of optimizing terms; 0 where the reward has a goal part alone.
        objective: the function whose value is recorded.
        seed: not used: nothing here is random.
        device: where J is computed.
        limits: largest mean raw value by name of the term, in its unit, above 0. A term without a
            limit keeps the weight 1; a limit without its term is passed over.
        reference, reference_share: read by the configuration, which puts limits in their place.
        integral_gain: change of a multiplier in an iteration at twice the limit.
        proportional_gain, derivative_gain: of the controller; 0 for dual ascent.
        initial: the multipliers at first, from 0 to `largest`; 1 is the static reward.
        largest: the multiplier that is not exceeded.

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
        limits: Mapping[str, float],
        reference: None = None,
        reference_share: float = 1.0,
        integral_gain: float = 0.01,
        proportional_gain: float = 0.0,
        derivative_gain: float = 0.0,
        initial: float = 1.0,
        largest: float = 10.0,
    ) -> None:
        check_integer("num_terms", num_terms, 0)
        for name, limit in limits.items():
            check_limit(name, limit)
        gains = {
            "integral_gain": integral_gain,
            "proportional_gain": proportional_gain,
            "derivative_gain": derivative_gain,
            "largest": largest,
        }
        for name, value in gains.items():
            check_number(name, value, 0.0, math.inf)
        check_number("initial", initial, 0.0, largest)
        super().__init__(num_terms, objective, device)
        self.limits = dict(limits)
        self.integral_gain = integral_gain
        self.proportional_gain = proportional_gain
        self.derivative_gain = derivative_gain
        self.largest = largest
        self.integral = torch.full((num_terms,), float(initial), dtype=torch.float64)
        # Above any cost, so that the first ones are no rise.
        self.costs = torch.full((num_terms,), torch.inf, dtype=torch.float64)
        self.weights = self.integral.clone()

    def observe(self, progress: TrainingProgress) -> None:
        """Move the multipliers by the costs of one iteration.

        Raises:
            ValueError: not one cost for each multiplier.
        """
        if len(progress.mean_terms) != self.num_terms:
            raise ValueError(
                f"there are costs of {list(progress.mean_terms)}, but {self.num_terms} multipliers"
            )
        names = list(progress.mean_terms)
        costs = torch.tensor([progress.mean_terms[name] for name in names], dtype=torch.float64)
        limits = torch.tensor(
            [self.limits.get(name, math.inf) for name in names], dtype=torch.float64
        )
        excess = costs / limits - 1.0
        rise = (costs - self.costs).clamp(min=0.0) / limits
        self.integral = self._bounded(self.integral + self.integral_gain * excess)
        self.costs = costs
        weights = self._bounded(
            self.integral + self.proportional_gain * excess + self.derivative_gain * rise
        )
        self.weights = torch.where(limits.isfinite(), weights, 1.0)

    def _bounded(self, multipliers: Tensor) -> Tensor:
        return multipliers.clamp(0.0, self.largest)

    def search(self, objective_fn: WeightFunction) -> SearchResult:
        """The multipliers, whatever their J."""
        return unsearched(self.weights.float().to(self.device), objective_fn)

    def state_dict(self) -> dict[str, Any]:
        """Multipliers and last costs (float64, [num_terms])."""
        return {
            "integral": self.integral.clone(),
            "costs": self.costs.clone(),
            "weights": self.weights.clone(),
        }

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Continue, bit for bit, from where `state_dict` was taken.

        Raises:
            ValueError: the state of another kind of optimizer.
        """
        check_state_names(state, {"integral", "costs", "weights"})
        self.integral = state["integral"].clone()
        self.costs = state["costs"].clone()
        self.weights = state["weights"].clone()


def check_limit(name: str, value: Any) -> None:
    """Refuse anything but a positive number: costs are compared with it by their ratio."""
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    if not (is_number and 0.0 < value < math.inf):
        raise ValueError(f"the limit of {name} must be a number above 0, got {value!r}")
