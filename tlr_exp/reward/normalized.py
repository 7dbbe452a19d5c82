"""An objective on terms that all vary alike, around any other objective."""

from dataclasses import dataclass

import torch
from torch import Tensor

from tlr_exp.reward.objectives import Objective, WeightFunction, check_returns


@dataclass
class NormalizedTerms:
    """J of another objective, after each term is divided by its spread between trajectories.

    The standard deviation of every term's returns over the trajectories of an iteration becomes
    that of r_g. A weight then says how much of a term is bearable relative to the goal, and no
    longer how large its coefficient is: J does not change with `reward.penalty_scale`. The reward
    that is learned from keeps its coefficients, so that its ranking is not the one judged here.

    Attributes:
        inner: the objective.
    """

    inner: Objective

    def prepare(self, goal_return: Tensor, term_returns: Tensor) -> WeightFunction:
        """J as a function of the weights; see `Objective.prepare`."""
        check_returns(goal_return, term_returns)
        return self.inner.prepare(goal_return, equally_spread(goal_return, term_returns))


def equally_spread(goal_return: Tensor, term_returns: Tensor) -> Tensor:
    """Term returns [num_envs, num_terms] whose standard deviations are that of r_g, float64.

    Terms that are the same for all trajectories stay as they are: they change no rank.

    Args:
        goal_return: r_g of each trajectory [num_envs].
        term_returns: [num_envs, num_terms].
    """
    # Sorted, so that the sums are the same to the bit however the environments were ordered.
    goal = _deviation(goal_return.detach().double().sort().values)
    ascending = term_returns.detach().double().sort(dim=0).values
    varies = ascending[0] < ascending[-1]
    spread = torch.where(varies, _deviation(ascending), 1.0)
    return term_returns.detach().double() * torch.where(varies, goal / spread, 1.0)


def _deviation(values: Tensor) -> Tensor:
    """Standard deviation over the first dimension."""
    return (values - values.mean(dim=0)).square().mean(dim=0).sqrt()
