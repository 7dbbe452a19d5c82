"""The gate around an optimizer: when it opens, and what is behind it."""

import pytest
import torch
from configured import make

from tlr_exp.optimizer.protocol import TrainingProgress
from tlr_exp.optimizer.when_tracking import WhenTracking
from tlr_exp.reward.objectives import RankDeviation

GOAL_RETURN = torch.tensor([3.0, 2.0, 1.0])
TERM_RETURNS = torch.tensor([[-1.0, -1.5], [0.0, 0.0], [0.0, 0.0]])


def gate(choice="curriculum", **settings) -> WhenTracking:
    return made_with("when_tracking", f"optimizer@optimizer.inner={choice}", **settings)


def made_with(*choices, **settings):
    return make(*choices, num_terms=2, objective=RankDeviation(0.34), seed=7, **settings)


def told(made: WhenTracking, *shares: float) -> list[float]:
    for share in shares:
        made.observe(TrainingProgress(100.0, 24, {"ang_vel_xy": 0.1, "lin_vel_z": 0.1}, share))
    return made.update(GOAL_RETURN, TERM_RETURNS).weights.tolist()


def test_until_the_goal_is_achieved_it_is_the_static_reward():
    made = gate(threshold=0.9)
    assert told(made, 0.5) == [1.0, 1.0]
    assert told(made, 0.899) == [1.0, 1.0]
    # The curriculum begins at 0.1 and has grown since the first iteration, three times 24 steps.
    assert told(made, 0.9) == pytest.approx([0.1 * 1.00001**72] * 2)


def test_without_a_lower_layer_before_j_is_what_it_is_there():
    made = gate(before=0.0)
    made.observe(TrainingProgress(100.0, 24, goal_share=0.1))
    update = made.update(GOAL_RETURN, TERM_RETURNS)
    assert update.weights.tolist() == [0.0, 0.0]
    # At the weights 1 the candidate falls to rank 3: ((1 - 3) / 100)^2.
    assert (update.objective, update.baseline_objective) == (0.0, 0.0004)
    assert update.evaluations == 0


@pytest.mark.parametrize(("stays", "weight"), [(True, 0.1), (False, 1.0)])
def test_an_open_gate_stays_open_if_it_is_told_to(stays, weight):
    made = gate(stays=stays, inner={"rate": 0.0})
    assert told(made, 0.95, 0.3) == pytest.approx([weight] * 2)


def test_nothing_known_opens_nothing():
    made = gate()
    made.observe(TrainingProgress(100.0, 24))
    assert not made.is_open


def test_an_open_gate_changes_nothing_of_the_search_behind_it():
    alone = made_with("gwo")
    assert told(gate("gwo", threshold=0.0), 0.0) == (
        alone.update(GOAL_RETURN, TERM_RETURNS).weights.tolist()
    )


@pytest.mark.parametrize("settings", [{"threshold": 1.5}, {"before": -0.1}, {"stays": "no"}])
def test_bad_settings_are_refused(settings):
    with pytest.raises(ValueError, match=next(iter(settings))):
        gate(**settings)
