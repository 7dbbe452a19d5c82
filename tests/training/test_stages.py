"""When a training enters the stages of a curriculum, and what they then change."""

import pytest
from learners import build_training

from tlr_exp import keys
from tlr_exp.config.settings import StageSettings
from tlr_exp.records.run_directory import RunDirectory
from tlr_exp.reward.split import RewardSplit
from tlr_exp.training.stages import Stages, stage_facts

FACTS = {"iteration": 10, "episode_length": 60.0, "goal_share": 0.85, "body_error_m": 0.1}


def stages(*conditions: dict[str, float]) -> Stages:
    """The first stage has none; each of these is for one more."""
    return Stages([StageSettings(each, {}, None, None) for each in ({}, *conditions)])


@pytest.mark.parametrize(
    ("condition", "entered"),
    [
        ({"iteration": 10}, True),
        ({"iteration": 11}, False),
        ({"episode_length": 59.5}, True),
        ({"goal_share": 0.9}, False),
        ({"body_error_m": 0.1}, True),
        ({"body_error_m": 0.09}, False),
        ({"iteration": 5, "goal_share": 0.8}, True),
        ({"iteration": 5, "goal_share": 0.9}, False),
    ],
)
def test_a_stage_is_entered_when_all_of_its_conditions_hold(condition, entered):
    made = stages(condition)
    assert made.advance(FACTS) is entered
    assert made.number == int(entered)


def test_stages_are_entered_one_at_a_time_in_order_and_not_left():
    made = stages({"goal_share": 0.8}, {"iteration": 1})
    numbers = [made.advance(facts) and made.number for facts in (FACTS, FACTS, FACTS)]
    assert numbers == [1, 2, False]
    made.advance({**FACTS, "goal_share": 0.0, "iteration": 0})
    assert made.number == 2


def test_what_is_not_a_number_fulfils_no_condition():
    made = stages({"goal_share": 0.0})
    assert not made.advance({**FACTS, "goal_share": float("nan")})


def test_a_training_follows_its_stages(tmp_path, settings_of):
    first = "{enter_when:{},weights:{ang_vel_xy:0.0},distance_m:0.9,start_phases:[0.0,0.0]}"
    then = "{enter_when:{iteration:2},weights:{lin_vel_z:0.25},distance_m:0.6,start_phases:null}"
    settings = settings_of(
        *("scale.num_envs=16", "scale.iterations=3", "scale.evaluate_every=3", "ppo.num_steps=4"),
        *("ppo.hidden_sizes=[16]", "num_threads=1", "physics.num_threads=1"),
        *("curriculum=hierarchical", f"stages=[{first},{then}]"),
    )
    training = build_training(settings, RunDirectory.create(tmp_path / "run", {"seed": 0}, {}))
    assert training.env.start_frame.unique().tolist() == [0]
    training.train()
    lines = training.run.metrics()
    assert [line[keys.STAGE] for line in lines] == [1, 1, 2]
    assert [line[f"{keys.WEIGHT_PREFIX}ang_vel_xy"] for line in lines] == [0.0, 0.0, 1.0]
    assert [line[f"{keys.WEIGHT_PREFIX}lin_vel_z"] for line in lines] == [1.0, 1.0, 0.25]
    limits = [line[keys.DISTANCE_LIMIT] for line in lines]
    assert limits == pytest.approx([0.9, 0.9, 0.6])


def test_facts_are_those_of_the_metrics():
    metrics = {
        keys.EPISODE_LENGTH: 50.0,
        keys.TRAIN_UPPER_BODY_ERROR: 0.1,
        keys.TRAIN_LOWER_BODY_ERROR: 0.3,
        f"{keys.REWARD_TERM_PREFIX}body_pos": 0.5,
        f"{keys.REWARD_TERM_PREFIX}ang_vel_xy": 7.0,
    }
    split = RewardSplit({"body_pos": 2.0}, {"ang_vel_xy": -1.0}, 0.02, ["body_pos", "ang_vel_xy"])
    assert stage_facts(4, metrics, split) == {
        "iteration": 4,
        "episode_length": 50.0,
        "goal_share": pytest.approx(0.5),
        "body_error_m": pytest.approx(0.2),
    }
