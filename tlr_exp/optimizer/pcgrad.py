"""A rival that takes from the terms' gradients what opposes the goal's: projection, as weights.

The projection is that of Yu, Kumar, Gupta, Levine, Hausman and Finn, "Gradient Surgery for
Multi-Task Learning" (NeurIPS 2020), for a goal that is not projected itself.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import torch
from torch import Tensor

from tlr_exp.optimizer.gradients import Comparison, GradientWeights
from tlr_exp.optimizer.protocol import PolicyGradients


@dataclass(kw_only=True, eq=False)
class ProjectedGradients(GradientWeights):
    """The weights that give the policy the direction of the projected gradients.

    With the gradient g of the goal and g_i of a term at weight 1, a term that opposes the goal
    loses its part along g:

        g_i' = g_i + c_i g,   c_i = max(0, - g_i . g / |g|^2).

    The sum is g + sum_i g_i' = (1 + C) g + sum_i g_i with C = sum_i c_i. Divided by 1 + C it is the
    gradient at weights

        w_i = 1 / (1 + C),

    the same for every term and always in (0, 1]. The learner normalises its advantages, so that the
    division changes nothing: as weights, the projection is exact, and it is one scale for the lower
    layer as a whole. Where no term opposes the goal this is the static reward.
    """

    def weigh(self, gradients: PolicyGradients) -> tuple[Tensor, Mapping[str, float]]:
        """One weight for all; the gradients' ratios and cosines."""
        compared = Comparison.of(gradients)
        # Where a gradient is 0, nothing is opposed.
        along = (compared.ratio * compared.cosine).nan_to_num(nan=0.0)
        opposition = (-along).clamp(min=0.0).sum()
        weights = torch.ones(self.num_terms) / (1.0 + opposition)
        return weights, self.comparison_by_term(compared)
