"""Objectives of the weight search: how far the optimizing reward distorts the goal reward.

An objective sees the returns of one iteration's trajectories and gives back a function of the
weights, to be minimised. It knows nothing of the search that minimises it.
"""

import math
from collections.abc import Callable
from fractions import Fraction
from typing import Protocol

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from tlr_exp.config.checks import check_between
from tlr_exp.errors import UserError

WeightFunction = Callable[[Tensor], Tensor]
"""Weights [pack, num_terms] -> objective [pack], float64, on the device of the weights."""


class NonFiniteReturnsError(UserError):
    """Trajectories have no rank, because a return of theirs is infinite or not a number."""


class Objective(Protocol):
    """What a weight optimizer needs of an objective."""

    def prepare(self, goal_return: Tensor, term_returns: Tensor) -> WeightFunction:
        """Do once what does not depend on the weights, and return the function of the weights.

        Args:
            goal_return: r_g of each trajectory [num_envs].
            term_returns: signed return of each optimizing term at weight 1
                [num_envs, num_terms].

        Raises:
            ValueError: shapes that do not fit, or values that are not finite.
        """
        ...


class TotalReturn:
    """r_t = r_g + r_o(w) of one iteration's trajectories, as a function of the weights.

    The trajectories stand in initial order: by r_g, those with equal r_g by their term returns,
    larger first, first term first. Those equal in everything cannot be told apart. In this order
    the arithmetic is the same to the bit however the environments were ordered.

    r_t is computed in float64, so that reduced-precision matrix products (TF32) change no rank.

    Args:
        goal_return: r_g of each trajectory [num_envs].
        term_returns: signed return of each optimizing term at weight 1 [num_envs, num_terms].

    Raises:
        ValueError: see `check_returns`.
    """

    def __init__(self, goal_return: Tensor, term_returns: Tensor) -> None:
        check_returns(goal_return, term_returns)
        order = _initial_order(goal_return, term_returns)
        self.goal = goal_return.detach()[order].double()
        self.terms = term_returns.detach()[order].double().T.contiguous()
        self._scratch = self.goal.new_empty(0)

    def __call__(self, weights: Tensor) -> Tensor:
        """r_t [pack, num_envs], float64, of weights [pack, num_terms]; until the next call."""
        if self._scratch.shape != (len(weights), len(self.goal)):
            # Reused from call to call: fresh pages would cost more than the product.
            self._scratch = self.goal.new_empty(len(weights), len(self.goal))
        return torch.addmm(self.goal, weights.to(self.goal), self.terms, out=self._scratch)


class BestByGoal:
    """What objectives share that look at the best trajectories by goal return, the candidates.

    Args:
        threshold_share: share of the trajectories that are candidates, strictly between 0 and 1.
            The paper uses 0.10.

    Raises:
        SettingError: a share outside (0, 1).
    """

    def __init__(self, threshold_share: float) -> None:
        check_between("threshold_share", threshold_share, 0.0, 1.0)
        self.threshold_share = float(threshold_share)

    def num_candidates(self, num_envs: int) -> int:
        """K = floor(threshold_share * num_envs).

        Raises:
            ValueError: K would be 0; the message names the share and the size that would do.
        """
        # The decimal as it is written: in binary floating point 0.29 * 100 is below 29.
        share = Fraction(str(self.threshold_share))
        num_candidates = math.floor(share * num_envs)
        if num_candidates < 1:
            raise UserError(
                f"threshold_share {self.threshold_share} of num_envs {num_envs} is less than one "
                f"candidate trajectory: use num_envs >= {math.ceil(1 / share)}, or "
                f"threshold_share >= {1 / max(num_envs, 1):g}"
            )
        return num_candidates


class RankDeviation(BestByGoal):
    """The paper's J: how far the best trajectories by goal reward fall in the total ranking.

    Equations 12 to 14: of E trajectories, the best K = floor(threshold_share * E) by goal return
    r_g are the candidates, with initial ranks N_ini = 1..K. With r_t = r_g + r_o(w), N_aft is a
    candidate's rank by r_t among all E, and

        J(w) = sum over the candidates with N_aft > K of ((N_ini - N_aft) / 100)^2.

    Ties, on which the paper is silent: trajectories with equal r_g are ordered by their term
    returns (see `TotalReturn`); trajectories with equal r_t keep that initial order. Hence J does
    not depend on the order of the environments, and J(0) = 0 exactly.

    Arguments and errors as `BestByGoal`.
    """

    def prepare(self, goal_return: Tensor, term_returns: Tensor) -> WeightFunction:
        """J as a function of the weights, for the trajectories of one iteration.

        Args:
            goal_return: r_g of each trajectory [num_envs].
            term_returns: signed return of each optimizing term at weight 1
                [num_envs, num_terms].

        Returns:
            weights [pack, num_terms] -> J [pack], float64.

        Raises:
            ValueError: shapes that do not fit, values that are not finite, no candidate.
        """
        total_return = TotalReturn(goal_return, term_returns)
        num_candidates = self.num_candidates(goal_return.shape[0])

        def objective(weights: Tensor) -> Tensor:
            squares = squared_shifts_(total_return(weights), num_candidates)
            return squares.to(weights.device) / 100.0**2

        return objective


class RetainedShare(BestByGoal):
    """How many of the best trajectories by goal reward are no longer among the best in all.

    With the candidates of `RankDeviation` and its ties, J(w) = 1 - R / K, where R of the K
    candidates have a rank by r_t of at most K. Unlike the paper's J it does not ask how far a
    candidate falls. It has K + 1 values, from 0 to 1, and J(0) = 0.

    Arguments and errors as `BestByGoal`.
    """

    def prepare(self, goal_return: Tensor, term_returns: Tensor) -> WeightFunction:
        """J as a function of the weights; see `RankDeviation.prepare`."""
        total_return = TotalReturn(goal_return, term_returns)
        num_candidates = self.num_candidates(goal_return.shape[0])

        def objective(weights: Tensor) -> Tensor:
            retained = retained_counts(total_return(weights), num_candidates)
            return 1.0 - retained.to(weights.device) / num_candidates

        return objective


def check_returns(goal_return: Tensor, term_returns: Tensor) -> None:
    """Refuse returns that cannot be ranked.

    Args:
        goal_return: [num_envs].
        term_returns: [num_envs, num_terms].

    Raises:
        ValueError: shapes that do not fit.
        NonFiniteReturnsError: values that are not finite.
    """
    if (
        goal_return.ndim != 1
        or term_returns.ndim != 2
        or term_returns.shape[0] != goal_return.shape[0]
    ):
        raise UserError(
            "expected goal_return [num_envs] and term_returns [num_envs, num_terms], got shapes "
            f"{tuple(goal_return.shape)} and {tuple(term_returns.shape)}"
        )
    for name, values in (("goal_return", goal_return), ("term_returns", term_returns)):
        finite = torch.isfinite(values)
        if not finite.all():
            bad = torch.nonzero(~finite)[:, 0].unique()
            raise NonFiniteReturnsError(
                f"{name} is not finite in {len(bad)} of {len(values)} environments, the first of "
                f"them {int(bad[0])}: such trajectories cannot be ranked"
            )


def retained_counts(total_return: Tensor, num_candidates: int) -> Tensor:
    """How many candidates have a rank of at most K, for each weight vector, float64 [pack].

    Args and ties: see `squared_shifts_`; `total_return` is left as it is.
    """
    first_kept = total_return.shape[1] - num_candidates
    if total_return.device.type == "cpu":
        # Many times faster than PyTorch's selection.
        ascending = np.partition(total_return.numpy(), first_kept, axis=1)
        worst_kept = torch.from_numpy(ascending[:, first_kept, None])
    else:
        worst_kept = total_return.topk(num_candidates, dim=1).values[:, -1:]
    candidates = total_return[:, :num_candidates]
    # The best ranks go to what is above the worst value kept; the rest to values equal to it, among
    # which candidates come first.
    left = num_candidates - (total_return > worst_kept).sum(dim=1)
    equal = (candidates == worst_kept).sum(dim=1)
    return ((candidates > worst_kept).sum(dim=1) + torch.minimum(equal, left)).double()


def squared_shifts_(total_return: Tensor, num_candidates: int) -> Tensor:
    """Sum of (N_ini - N_aft)^2 over the candidates with N_aft > K, for each weight vector.

    Args:
        total_return: r_t, float64 [pack, num_envs], trajectories in initial order: index i has
            initial rank i + 1, and of equal values the earlier index ranks first. May be
            overwritten.
        num_candidates: K; the candidates are the first K indices.

    Returns:
        float64 [pack]; the values are whole numbers.
    """
    if total_return.device.type != "cpu":
        return _shifts_by_full_sort(total_return, num_candidates)
    return _shifts_by_search_(total_return, num_candidates)


def _shifts_by_full_sort(total_return: Tensor, num_candidates: int) -> Tensor:
    """`squared_shifts_` on any device, by a stable sort of every row."""
    order = total_return.sort(dim=1, descending=True, stable=True).indices
    beyond = order[:, num_candidates:]  # who holds ranks K + 1 .. E, as initial rank - 1
    rank = torch.arange(num_candidates, order.shape[1], device=order.device)
    shift = (beyond - rank).masked_fill(beyond >= num_candidates, 0)
    return shift.square().sum(dim=1).double()


def _shifts_by_search_(total_return: Tensor, num_candidates: int) -> Tensor:
    """`squared_shifts_` on a CPU, in place, many times faster than a sort that keeps indices.

    A partition finds the K-th best value of each row. Only rows in which a candidate fell below
    it are sorted, as bare values, which NumPy does with vector instructions; the places of the
    fallen candidates in the sorted row are their ranks.
    """
    rows = total_return.numpy()
    num_envs = rows.shape[1]
    candidates = rows[:, :num_candidates].copy()
    rows.partition(num_envs - num_candidates, axis=1)
    worst_kept = rows[:, num_envs - num_candidates]
    best_dropped = rows[:, : num_envs - num_candidates].max(axis=1)
    squares = np.zeros(len(rows))
    for row in np.flatnonzero((candidates.min(axis=1) < worst_kept) | (best_dropped == worst_kept)):
        index = np.flatnonzero(candidates[row] <= worst_kept[row])
        values = candidates[row, index]
        ascending = rows[row]
        ascending.sort()
        # N_aft - 1: the larger values, and the equal ones that ranked higher at first.
        rank = num_envs - ascending.searchsorted(values, side="right")
        if (ascending[1:] == ascending[:-1]).any():
            rank += _earlier_equals(values)
        shift = (rank - index)[rank >= num_candidates].astype(np.float64)
        squares[row] = shift @ shift
    return torch.from_numpy(squares)


def _earlier_equals(values: NDArray[np.float64]) -> NDArray[np.int64]:
    """For each value, how many equal ones stand before it [n]."""
    order = values.argsort(kind="stable")
    in_order = values[order]
    earlier = np.empty(len(values), dtype=np.int64)
    earlier[order] = np.arange(len(values)) - in_order.searchsorted(in_order, side="left")
    return earlier


def _initial_order(goal_return: Tensor, term_returns: Tensor) -> Tensor:
    """Indices that sort by goal return, then by each term return, all larger first [num_envs]."""
    order = torch.arange(goal_return.shape[0], device=goal_return.device)
    # Stable sorts from the least to the most important key.
    for key in (*reversed(term_returns.unbind(dim=1)), goal_return):
        order = order[key[order].sort(descending=True, stable=True).indices]
    return order
