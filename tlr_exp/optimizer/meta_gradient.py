"""A rival that learns the weights from what the goal gains once the policy has used them.

After Zheng, Oh and Singh, "On Learning Intrinsic Rewards for Policy Gradient Methods" (NeurIPS
2018), with weights of given terms in the place of a network that invents a reward. The paper that
this project repeats names such methods and calls them high in variance, so that is recorded.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import torch
from torch import Tensor

from tlr_exp.config.checks import check_above, check_between
from tlr_exp.optimizer.gradients import GradientWeights
from tlr_exp.optimizer.protocol import PolicyGradients


@dataclass(kw_only=True, eq=False)
class MetaGradient(GradientWeights):
    """Weights that climb the goal's objective as it is after one update of the policy by them.

    The update is a plain gradient step from the present policy theta on the surrogate at weights w,

        theta'(w) = theta + step_size (g + sum_i w_i g_i),

    shortened where it is steep, as the learner does it (by `max_grad_norm`, taken for a constant).
    The goal's surrogate J there has, by the chain rule, the derivative

        dJ(theta'(w)) / dw_i = step_size grad J(theta'(w)) . g_i.

    Step and derivative come from different trajectories: from one half of the batch and the other,
    and the other way round. From the same ones, the noise that both share would be taken for gain.
    The mean m of these two estimates moves the weights by Adam (Kingma and Ba 2015), from 1 and
    within the box; half their difference is the standard error of m. Recorded are both by term and,
    as `meta_gradient_noise`, the length of the error over that of m: beyond 1 there is more noise
    than signal.

    Attributes:
        step_size: of the policy's step, on advantages whose standard deviation is 1 for the goal.
        max_grad_norm: longest gradient of that step, above 0; a longer one is scaled to this.
        rate: about how far a weight moves in an iteration in which the sign of m is steady.
        mean_decay, square_decay: Adam's beta 1 and beta 2, above 0 and below 1.
        lower, upper: the box.
        mean, square, updates: Adam's running means of m and its square [num_terms], their number.
    """

    step_size: float
    max_grad_norm: float
    rate: float
    mean_decay: float
    square_decay: float
    lower: float
    upper: float

    def __post_init__(self) -> None:
        super().__post_init__()
        check_above("step_size", self.step_size, 0.0)
        check_above("max_grad_norm", self.max_grad_norm, 0.0)
        check_above("rate", self.rate, 0.0)
        check_between("mean_decay", self.mean_decay, 0.0, 1.0)
        check_between("square_decay", self.square_decay, 0.0, 1.0)
        self.set_box(self.lower, self.upper, tie_break="first")
        self.mean = torch.zeros(self.num_terms, dtype=torch.float64)
        self.square = torch.zeros_like(self.mean)
        self.updates = torch.zeros((), dtype=torch.float64)
        self.saved = (*self.saved, "mean", "square", "updates")

    def weigh(self, gradients: PolicyGradients) -> tuple[Tensor, Mapping[str, float]]:
        """The weights, one step of Adam further; the meta-gradient and its error."""
        one, other = gradients.halves()
        estimates = torch.stack((self.derivative(one, other), self.derivative(other, one)))
        derivative, error = estimates.mean(dim=0), estimates.diff(dim=0)[0].abs() / 2.0
        details = {
            **self.by_term("meta_gradient", derivative),
            **self.by_term("meta_gradient_error", error),
            "meta_gradient_noise": (error.norm() / derivative.norm()).item(),
        }
        weights = self.last_weights.double().cpu() + self._adam_step(derivative)
        return weights.clamp(self.lower, self.upper), details

    def derivative(self, learning: PolicyGradients, judging: PolicyGradients) -> Tensor:
        """dJ(theta'(w)) / dw at the present weights [num_terms], float64 on the CPU.

        The policy takes its step on `learning`; J is of `judging`.
        """
        terms = learning.terms
        gradient = learning.goal + self.last_weights.to(terms) @ terms
        length = self.step_size * (self.max_grad_norm / gradient.norm()).clamp(max=1.0)
        gained = judging.goal_after(length * gradient)
        return (length * (terms.double() @ gained.double())).cpu()

    def _adam_step(self, derivative: Tensor) -> Tensor:
        """How far the weights move, upwards along the derivative [num_terms]."""
        # What is no number says nothing, and must not stay in the means for good.
        derivative = derivative.nan_to_num(nan=0.0, posinf=0.0, neginf=0.0)
        self.updates = self.updates + 1.0
        self.mean = torch.lerp(derivative, self.mean, self.mean_decay)
        self.square = torch.lerp(derivative.square(), self.square, self.square_decay)
        mean = self.mean / (1.0 - self.mean_decay**self.updates)
        square = self.square / (1.0 - self.square_decay**self.updates)
        # A term without a gradient keeps its weight.
        return self.rate * (mean / square.sqrt()).nan_to_num(nan=0.0)
