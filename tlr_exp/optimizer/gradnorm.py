"""A rival that balances gradients: each term pulls with a stated part of the goal's force.

The means of Chen, Badrinarayanan, Lee and Rabinovich, "GradNorm: Gradient Normalization for
Adaptive Loss Balancing in Deep Multitask Networks" (ICML 2018), for a goal that keeps its weight.
"""

from collections.abc import Mapping
from dataclasses import dataclass

from torch import Tensor

from tlr_exp.config.checks import check_above, check_within
from tlr_exp.optimizer.gradients import Comparison, GradientWeights
from tlr_exp.optimizer.protocol import PolicyGradients


@dataclass(kw_only=True, eq=False)
class GradNormWeights(GradientWeights):
    """Weights at which the gradient of each term is `ratio` times as long as the goal's.

    With the gradient g of the goal and g_i of a term at weight 1, the target is

        w_i* = clip(ratio |g| / |g_i|, lower, upper),

    and in every iteration w_i <- w_i + rate (w_i* - w_i), from w_i = 1. GradNorm moves its weights
    down the slope of sum_i | w_i |g_i| - target |; here the weights that end the descent are known,
    because the gradients of an iteration do not depend on its weights. GradNorm's other part, which
    lets tasks that lag behind pull harder, needs losses that fall to 0, and is left out: its
    exponent alpha is 0. A term whose gradient is 0 gets the largest weight.

    Attributes:
        ratio: length of a term's weighted gradient over that of the goal's, above 0.
        rate: share of the way to the target that is made in an iteration, from 0 to 1.
        lower, upper: the box.
    """

    ratio: float
    rate: float
    lower: float
    upper: float

    def __post_init__(self) -> None:
        super().__post_init__()
        check_above("ratio", self.ratio, 0.0)
        check_within("rate", self.rate, 0.0, 1.0)
        self.set_box(self.lower, self.upper, tie_break="first")

    def weigh(self, gradients: PolicyGradients) -> tuple[Tensor, Mapping[str, float]]:
        """The weights, moved towards their targets; the gradients' ratios and cosines."""
        compared = Comparison.of(gradients)
        # 0 / 0: without any gradient, too, a term does nothing at any weight.
        target = (self.ratio / compared.ratio).nan_to_num(nan=self.upper)
        before = self.last_weights.double().cpu()
        weights = before + self.rate * (target.clamp(self.lower, self.upper) - before)
        return weights, self.comparison_by_term(compared)
