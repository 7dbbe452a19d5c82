"""A constrained rival of the weight search: each cost of the lower layer has a limit.

The weights are Lagrange multipliers. One rises while its cost is above the limit and falls while it
is below, so that in the end each term weighs as much as its limit needs. J has no say.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass

import torch
from torch import Tensor

from tlr_exp.config.checks import check_above, check_at_least, check_within
from tlr_exp.errors import UserError
from tlr_exp.optimizer.base import ChosenWeights
from tlr_exp.optimizer.protocol import TrainingProgress
from tlr_exp.optimizer.search import SearchResult, unsearched
from tlr_exp.reward.objectives import WeightFunction


@dataclass(kw_only=True, eq=False)
class LagrangianWeights(ChosenWeights):
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

    Attributes:
        limits: largest mean raw value by name of the term, in its unit, above 0. A term without a
            limit keeps the weight 1; a limit without its term is passed over.
        reference, reference_share: read by the configuration, which puts limits in their place.
        integral_gain: change of a multiplier in an iteration at twice the limit.
        proportional_gain, derivative_gain: of the controller; 0 for dual ascent.
        initial: the multipliers at first, from 0 to `largest`; 1 is the static reward.
        largest: the multiplier that is not exceeded, above 0.
        integral, costs, weights: I, c_before and w of each term, float64 [num_terms].
    """

    limits: Mapping[str, float]
    reference: str | None
    reference_share: float
    integral_gain: float
    proportional_gain: float
    derivative_gain: float
    initial: float
    largest: float

    def __post_init__(self) -> None:
        super().__post_init__()
        for name, limit in self.limits.items():
            check_above(f"limits.{name}", limit, 0.0)
        check_above("reference_share", self.reference_share, 0.0)
        check_at_least("integral_gain", self.integral_gain, 0.0)
        check_at_least("proportional_gain", self.proportional_gain, 0.0)
        check_at_least("derivative_gain", self.derivative_gain, 0.0)
        check_above("largest", self.largest, 0.0)
        check_within("initial", self.initial, 0.0, self.largest)
        self.integral = torch.full((self.num_terms,), float(self.initial), dtype=torch.float64)
        self.costs = torch.full_like(self.integral, torch.inf)  # so that the first are no rise
        self.weights = self.integral.clone()
        self.saved = ("integral", "costs", "weights")

    def observe(self, progress: TrainingProgress) -> None:
        """Move the multipliers by the costs of one iteration.

        Raises:
            UserError: not one cost for each multiplier.
        """
        names = list(progress.mean_terms)
        if len(names) != self.num_terms:
            raise UserError(f"there are costs of {names}, but {self.num_terms} multipliers")
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
