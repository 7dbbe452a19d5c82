"""Optimizers that change the weights of another one: averaged, times a curriculum, by stages."""

from dataclasses import replace

import pytest
import torch
from configured import make

from tlr_exp.optimizer.protocol import TrainingProgress
from tlr_exp.reward.objectives import RankDeviation

OBJECTIVE = RankDeviation(0.34)
GOAL_RETURN = torch.tensor([3.0, 2.0, 1.0])
TERM_RETURNS = torch.tensor([[-1.0, -1.5], [0.0, 0.0], [0.0, 0.0]])
TOLD = TrainingProgress(100.0, 24, {"ang_vel_xy": 0.1, "lin_vel_z": 0.1}, 0.9)


def made_with(*choices, **settings):
    return make(*choices, num_terms=2, objective=OBJECTIVE, seed=7, **settings)


def weights_of(made, iterations=1):
    """What it returns in each iteration [iterations, num_terms]."""
    found = []
    for _ in range(iterations):
        made.observe(TOLD)
        found.append(made.update(GOAL_RETURN, TERM_RETURNS).weights)
    return torch.stack(found)


def test_the_average_starts_at_the_static_reward_and_follows_the_optimizer_inside():
    found = weights_of(made_with("smoothed", "optimizer@optimizer.inner=zero", share=0.25), 3)
    # 1, then 3/4 of it in every iteration.
    assert found[:, 0].tolist() == [0.75, 0.75**2, 0.75**3]
    assert torch.equal(found[:, 0], found[:, 1])


@pytest.mark.parametrize("choice", ["gwo", "random"])
def test_an_average_of_the_new_weights_alone_is_the_optimizer_inside(choice):
    smoothed = made_with("smoothed", f"optimizer@optimizer.inner={choice}", share=1.0)
    assert torch.equal(weights_of(smoothed, 3), weights_of(made_with(choice), 3))


def test_an_average_jumps_less_than_what_it_averages():
    inside = weights_of(made_with("random"), 40)
    averaged = weights_of(made_with("smoothed", "optimizer@optimizer.inner=random"), 40)
    assert averaged.diff(dim=0).abs().max() < 0.2 * inside.diff(dim=0).abs().max()


@pytest.mark.parametrize("choice", ["smoothed", "under_curriculum"])
def test_j_is_that_of_the_weights_in_use_and_the_search_is_counted(choice):
    made = made_with(choice)
    made.observe(TOLD)
    update = made.update(GOAL_RETURN, TERM_RETURNS)
    objective_fn = OBJECTIVE.prepare(GOAL_RETURN, TERM_RETURNS)
    assert update.objective == objective_fn(update.weights[None]).item()
    # At the weights 1 the candidate falls to rank 3: ((1 - 3) / 100)^2.
    assert update.baseline_objective == 0.0004
    assert update.evaluations == 30 + 30 * 50


@pytest.mark.parametrize("share", [0.0, 1.5])
def test_a_share_that_averages_nothing_is_refused(share):
    with pytest.raises(ValueError, match=r"share is .*; allowed"):
        made_with("smoothed", share=share)


def test_under_the_curriculum_weights_are_those_inside_times_its_scale():
    made = made_with("under_curriculum", "optimizer@optimizer.inner=random")
    scale = torch.tensor([0.1 * 1.00001**24, 0.1 * 1.00001**48])[:, None]
    expected = weights_of(made_with("random"), 2) * scale
    torch.testing.assert_close(weights_of(made, 2), expected)


def test_around_the_static_reward_it_is_the_curriculum():
    around = made_with("under_curriculum", "optimizer@optimizer.inner=fixed")
    assert torch.equal(weights_of(around, 3), weights_of(made_with("curriculum"), 3))


def test_a_part_without_a_scale_is_no_curriculum():
    with pytest.raises(ValueError, match="curriculum makes a FixedWeights, which has no scale"):
        made_with("under_curriculum", "optimizer@optimizer.curriculum=fixed")


def told_by_stage(made, stage_weights):
    made.observe(replace(TOLD, stage_weights=stage_weights))
    return made.update(GOAL_RETURN, TERM_RETURNS).weights.tolist()


def test_a_stage_sets_the_weights_that_it_names_and_no_others():
    made = made_with("staged", "optimizer@optimizer.inner=curriculum", inner={"rate": 0.0})
    scale = pytest.approx(0.1)
    assert told_by_stage(made, {"lin_vel_z": 0.5}) == [scale, 0.5]
    assert told_by_stage(made, {"ang_vel_xy": 0.0, "lin_vel_z": 1.0, "torques": 0.3}) == [0.0, 1.0]
    assert told_by_stage(made, {}) == [scale, scale]


def test_one_can_stand_around_the_other_and_goes_on_bit_for_bit():
    choices = ("smoothed", "optimizer@optimizer.inner=under_curriculum")
    alone = made_with(*choices)
    weights_of(alone, 2)
    resumed = made_with(*choices)
    resumed.load_state_dict(alone.state_dict())
    assert torch.equal(weights_of(resumed, 2), weights_of(alone, 2))
