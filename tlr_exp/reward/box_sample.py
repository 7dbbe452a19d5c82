"""How much of the weight box is optimal: whether a weight search has anything to find."""

import torch
from torch import Tensor
from torch.quasirandom import SobolEngine

from tlr_exp.reward.objectives import Objective

SAMPLE_SIZE = 256  # a share is known to 0.4 %
_SCRAMBLE_SEED = 0  # the same sample in every run, so that shares compare between runs


class BoxSample:
    """A fixed quasi-random sample of the box [0, 1]^num_terms, the paper's box of weights.

    It is the same for every optimizer, those included that search another box or none.

    Args:
        num_terms: number of optimizing terms.
        objective: the function of the weights that is looked at.
        size: number of weight vectors.
    """

    def __init__(self, num_terms: int, objective: Objective, size: int = SAMPLE_SIZE) -> None:
        self.objective = objective
        # A Sobol sequence needs a dimension; without terms all weight vectors are the empty one.
        points = SobolEngine(max(num_terms, 1), scramble=True, seed=_SCRAMBLE_SEED).draw(size)
        self.weights = points[:, :num_terms]

    @torch.no_grad()
    def optimal_share(self, goal_return: Tensor, term_returns: Tensor, found: float) -> float:
        """Share of the sample whose J is minimal, for the trajectories of one iteration.

        Args:
            goal_return: r_g of each trajectory [num_envs].
            term_returns: signed return of each optimizing term at weight 1
                [num_envs, num_terms].
            found: J at the weights in use. A sample in which nothing is as good has share 0.

        Raises:
            ValueError: returns that the objective refuses.
        """
        objective_fn = self.objective.prepare(goal_return.cpu(), term_returns.cpu())
        values = objective_fn(self.weights)
        minimum = min(values.min().item(), found)
        return (values == minimum).double().mean().item()
