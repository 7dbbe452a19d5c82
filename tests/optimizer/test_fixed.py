"""The static baseline."""

import pytest
import torch
from configured import make

from tlr_exp.reward.objectives import RankDeviation


def test_weights_are_one_and_their_objective_is_recorded() -> None:
    # K = floor(0.34 * 3) = 1, the candidate is the first: r_t = 3 - 2.5, 2, 1; it falls to
    # rank 3: ((1 - 3) / 100)^2.
    update = make("fixed", num_terms=2, objective=RankDeviation(0.34)).update(
        torch.tensor([3.0, 2.0, 1.0]), torch.tensor([[-1.0, -1.5], [0.0, 0.0], [0.0, 0.0]])
    )
    assert update.weights.tolist() == [1.0, 1.0]
    assert update.objective == update.baseline_objective == 0.0004
    assert update.evaluations == 0
    assert update.optimal_share == 1.0


def test_a_reward_with_a_goal_alone_needs_no_weights() -> None:
    fixed = make("fixed", num_terms=0, objective=RankDeviation(0.34))
    update = fixed.update(torch.arange(3.0), torch.zeros(3, 0))
    assert update.weights.shape == (0,)
    assert update.objective == 0.0


def test_a_negative_number_of_terms_is_refused() -> None:
    with pytest.raises(ValueError, match="num_terms"):
        make("fixed", num_terms=-1)
