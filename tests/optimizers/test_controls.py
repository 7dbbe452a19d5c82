"""The controls that a claim for a search must beat: no lower layer, chance, ASAP's curriculum."""

from typing import Any

import pytest
import torch
from landscapes import Recorder, uneven_bowl

from tlr_exp.objective import RankDeviation
from tlr_exp.optimizers.curriculum import PenaltyCurriculum
from tlr_exp.optimizers.protocol import TrainingProgress
from tlr_exp.optimizers.random_search import random_search
from tlr_exp.optimizers.zero import ZeroWeights

GOAL_RETURN = torch.tensor([3.0, 2.0, 1.0])
TERM_RETURNS = torch.tensor([[-1.0, -1.5], [0.0, 0.0], [0.0, 0.0]])


def test_without_a_lower_layer_no_rank_changes() -> None:
    # At the weights 1 the candidate falls to rank 3: ((1 - 3) / 100)^2.
    update = ZeroWeights(2, RankDeviation(0.34)).update(GOAL_RETURN, TERM_RETURNS)
    assert update.weights.tolist() == [0.0, 0.0]
    assert update.objective == 0.0
    assert update.baseline_objective == 0.0004
    assert update.evaluations == 0


def test_random_search_is_the_best_of_its_uniform_draws() -> None:
    recorder = Recorder(uneven_bowl)
    lower, upper = torch.tensor([0.0, 0.5]), torch.tensor([1.0, 1.0])
    found = random_search(recorder, lower, upper, 2000, torch.Generator().manual_seed(0))
    draws = torch.cat(recorder.packs)
    assert len(draws) == 2000
    assert torch.equal(found.position, draws[torch.cat(recorder.values).argmin()])
    # Mean (0.5, 0.75), standard deviation width / sqrt(12); five standard errors.
    error = 5.0 * (upper - lower) / 12**0.5 / 2000**0.5
    assert ((draws.mean(dim=0) - torch.tensor([0.5, 0.75])).abs() < error).all()
    assert found.optimal_share == 1 / 2000


def scale_after(*lengths: float, num_steps: int = 24, **settings: Any) -> float:
    curriculum = PenaltyCurriculum(2, RankDeviation(0.34), **settings)
    for length in lengths:
        curriculum.observe(TrainingProgress(length, num_steps))
    update = curriculum.update(GOAL_RETURN, TERM_RETURNS)
    assert update.weights[0] == update.weights[1]
    return update.weights[0].item()


def test_the_scale_follows_the_length_of_the_episodes() -> None:
    assert scale_after() == pytest.approx(0.1)
    # In each of 24 control steps by 1e-5: 0.1 * 1.00001^24 = 0.1 + 2.4003e-5.
    assert scale_after(42.5) == pytest.approx(0.1 + 2.4003e-5, abs=1e-8)
    assert scale_after(39.5) == pytest.approx(0.1 - 2.3997e-5, abs=1e-8)
    assert scale_after(40.0, 41.0, 42.0) == pytest.approx(0.1)
    assert scale_after(100.0, 100.0, num_steps=2, rate=0.5) == pytest.approx(0.1 * 1.5**4)
    assert scale_after(10.0, num_steps=2, rate=0.5) == pytest.approx(0.1 * 0.5**2)


def test_the_scale_stops_at_its_largest_value_and_comes_back_from_it() -> None:
    settings = {"rate": 0.1, "num_steps": 100}
    assert scale_after(50.0, **settings) == 1.0
    assert scale_after(50.0, 10.0, **settings) == pytest.approx(0.9**100)
    assert scale_after(50.0, largest=0.3, **settings) == pytest.approx(0.3)


def test_a_curriculum_does_without_terms() -> None:
    update = PenaltyCurriculum(0, RankDeviation(0.34)).update(GOAL_RETURN, torch.zeros(3, 0))
    assert update.weights.shape == (0,)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"initial": 2.0}, r"initial must be a number from 0 to 1, got 2\.0"),
        ({"rate": -0.1}, r"rate must be a number from 0 to 1, got -0\.1"),
        ({"largest": -1.0}, r"largest must be a number from 0 to inf, got -1\.0"),
        ({"shrink_below_steps": 50.0}, r"shrink_below_steps 50\.0 exceeds grow_above_steps 42\.0"),
    ],
)
def test_bad_settings_are_refused(settings: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        PenaltyCurriculum(2, RankDeviation(), **settings)
