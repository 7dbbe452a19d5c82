"""The share of the weight box that is optimal, on objectives whose optimal region is known."""

import torch
from torch import Tensor

from tlr_exp.reward.box_sample import BoxSample
from tlr_exp.reward.objectives import RankDeviation, WeightFunction


class HalfBox:
    """J = 0 where the first weight is below one half, 1 elsewhere."""

    def prepare(self, goal_return: Tensor, term_returns: Tensor) -> WeightFunction:
        return lambda weights: (weights[:, 0] >= 0.5).double()


NO_RETURNS = torch.zeros(4), torch.zeros(4, 3)


def test_share_is_the_volume_of_the_optimal_region() -> None:
    # A Sobol sample of a power of two splits evenly at one half.
    assert BoxSample(3, HalfBox()).optimal_share(*NO_RETURNS, found=0.0) == 0.5


def test_share_is_zero_where_the_search_found_better_than_the_sample() -> None:
    assert BoxSample(3, HalfBox()).optimal_share(*NO_RETURNS, found=-1.0) == 0.0


def test_a_search_that_missed_the_minimum_does_not_set_the_level() -> None:
    assert BoxSample(3, HalfBox()).optimal_share(*NO_RETURNS, found=1.0) == 0.5


def test_everything_is_optimal_where_penalties_are_too_small_to_change_a_rank() -> None:
    goal = torch.arange(20.0)
    terms = -1e-3 * torch.rand(20, 2, generator=torch.Generator().manual_seed(0))
    sample = BoxSample(2, RankDeviation(0.1))
    assert sample.optimal_share(goal, terms, found=0.0) == 1.0


def test_a_rank_flip_by_hand() -> None:
    """Two trajectories a unit of goal return apart; the better one pays 2 w: it falls if w > 1/2.

    Candidates: K = floor(0.5 * 2) = 1. So J = ((1 - 2) / 100)^2 for w > 1/2 and 0 below.
    """
    goal, terms = torch.tensor([1.0, 0.0]), torch.tensor([[-2.0], [0.0]])
    sample = BoxSample(1, RankDeviation(0.5))
    assert sample.optimal_share(goal, terms, found=0.0) == 0.5


def test_without_terms_all_of_the_box_is_optimal() -> None:
    sample = BoxSample(0, RankDeviation(0.5))
    assert sample.optimal_share(torch.arange(4.0), torch.zeros(4, 0), found=0.0) == 1.0


def test_the_sample_is_the_same_in_every_run_whatever_the_global_generator() -> None:
    torch.manual_seed(1)
    first = BoxSample(6, HalfBox()).weights
    torch.manual_seed(2)
    assert torch.equal(first, BoxSample(6, HalfBox()).weights)
