"""All measures of a hand-made trajectory, and what is made of several."""

import dataclasses
import io
import json
import math

import numpy as np
import pytest
from rich.console import Console
from trajectories import still_trajectory

from tlr_exp import keys
from tlr_exp.commands.evaluate.result_table import result_table
from tlr_exp.evaluation.measures import MEASURES
from tlr_exp.evaluation.result import evaluate_trajectory, mean_metrics
from tlr_exp.keys import Ending
from tlr_exp.reward.split import RewardSplit
from tlr_exp.robot.g1 import G1

SPLIT = RewardSplit({"body_pos": 2.0}, {"base_height": -4.0}, 0.02, ["body_pos", "base_height"])


def test_errors_are_means_over_the_bodies_of_each_half():
    trajectory = still_trajectory()
    # Both hands 0.11 m off all the time: 2 of the 11 upper bodies, none of the lower ones.
    for name in ("left_hand", "right_hand"):
        trajectory.body_pos_w[:, G1.tracked_bodies.index(name), 1] = 0.11
    # The pelvis 0.32 m off in half of the steps: 1 of the 16 lower bodies.
    trajectory.body_pos_w[:50, G1.pelvis, 2] = 0.32
    trajectory.qpos[:, 7] = 0.23  # one of 23 joints
    result = evaluate_trajectory(trajectory, max_tilt=0.8, max_distance_m=1.0, split=SPLIT)
    assert result.upper_body_error_m == pytest.approx(0.02)
    assert result.lower_body_error_m == pytest.approx(0.01)
    assert result.joint_error_rad == pytest.approx(0.01)
    assert result.terms == {"base_height": pytest.approx(0.5), "body_pos": pytest.approx(0.75)}
    # Coefficient times mean term, each layer by itself.
    assert result.goal_reward_per_s == pytest.approx(2.0 * 0.75)
    assert result.lower_layer_cost_per_s == pytest.approx(4.0 * 0.5)
    assert result.survival == result.upright == 1.0
    assert result.duration_s == pytest.approx(2.0)


def test_a_fall_and_a_stray_body_end_survival_and_only_a_fall_uprightness():
    trajectory = still_trajectory()
    trajectory.body_pos_w[40:45, 3, 0] = 0.31
    trajectory.qpos[70:, 3:7] = [math.sqrt(0.5), math.sqrt(0.5), 0.0, 0.0]  # on its side
    result = evaluate_trajectory(trajectory, max_tilt=0.8, max_distance_m=0.3, split=SPLIT)
    assert result.survival == pytest.approx(0.40)
    assert result.upright == pytest.approx(0.70)
    assert result.ended_by == Ending.TOO_FAR
    assert not result.succeeded


def test_instability_ends_survival_and_is_counted():
    trajectory = still_trajectory()
    trajectory.unstable[25:] = True
    result = evaluate_trajectory(trajectory, max_tilt=0.8, max_distance_m=0.3, split=SPLIT)
    assert result.survival == result.upright == pytest.approx(0.25)
    assert result.unstable_steps == 75
    assert result.ended_by == Ending.UNSTABLE


def test_result_as_json_metrics_and_table():
    result = evaluate_trajectory(still_trajectory(), max_tilt=0.8, max_distance_m=0.3, split=SPLIT)
    written = json.loads(json.dumps(result.to_dict(), allow_nan=False))
    assert written["latency_ms"] is None
    assert written["latency_reason"]
    metrics = result.metrics()
    assert metrics[keys.EVAL_PREFIX + "survival"] == 1.0
    assert metrics[keys.EVAL_PREFIX + keys.REWARD_TERM_PREFIX + "base_height"] == 0.5
    assert math.isnan(metrics[keys.EVAL_PREFIX + "latency_ms"])
    text = io.StringIO()
    Console(width=100, file=text).print(result_table(result, "a run"))
    for shown in ("a run", "upper-body error", "base_height", result.latency_reason):
        assert shown in text.getvalue()


def test_metrics_of_several_roll_outs_are_means_of_what_is_known():
    result = evaluate_trajectory(still_trajectory(), max_tilt=0.8, max_distance_m=0.3, split=SPLIT)
    terms = {**result.terms, "base_height": 1.5}
    fallen = dataclasses.replace(
        result, survival=0.25, ended_by=Ending.FELL, latency_ms=30.0, terms=terms
    )
    means = mean_metrics([result, fallen, dataclasses.replace(fallen, latency_ms=50.0)])
    assert means[keys.EVAL_PREFIX + "survival"] == pytest.approx(0.5)
    assert means[keys.EVAL_SUCCESS] == pytest.approx(1 / 3)
    assert means[f"{keys.EVAL_ENDED_BY}fell"] == pytest.approx(2 / 3)
    assert means[f"{keys.EVAL_ENDED_BY}completed"] == pytest.approx(1 / 3)
    assert means[f"{keys.EVAL_ENDED_BY}too_far"] == 0.0
    assert means[keys.EVAL_PREFIX + "latency_ms"] == pytest.approx(40.0)
    assert means[keys.EVAL_PREFIX + keys.REWARD_TERM_PREFIX + "base_height"] == pytest.approx(
        (0.5 + 1.5 + 1.5) / 3
    )
    # One roll-out has its own numbers, and no share of successes.
    assert repr(mean_metrics([result])) == repr(result.metrics())
    assert math.isnan(mean_metrics([result, result])[keys.EVAL_PREFIX + "latency_ms"])


def test_a_motion_that_runs_beside_its_reference_is_off_in_the_world_alone():
    made = still_trajectory(50)
    spread = np.random.default_rng(0).uniform(-0.3, 0.3, made.body_pos_w.shape)
    reference = made.reference_body_pos_w + spread
    beside = dataclasses.replace(
        made, reference_body_pos_w=reference, body_pos_w=reference + np.array([0.0, 0.2, 0.0])
    )
    result = evaluate_trajectory(beside, max_tilt=0.8, max_distance_m=0.3, split=SPLIT)
    assert result.upper_body_error_m == pytest.approx(0.2)
    assert result.lower_body_error_m == pytest.approx(0.2)
    assert result.upper_body_error_root_m == pytest.approx(0.0, abs=1e-12)
    assert result.lower_body_error_root_m == pytest.approx(0.0, abs=1e-12)
    assert result.ended_by == Ending.COMPLETED


def test_velocities_and_torques_by_hand():
    made = still_trajectory()
    made.qvel[:, 6] = 2.3  # one of 23 joints, against a reference at rest
    made.qvel[:, :6] = 7.0  # the root's velocities are no joint's
    made.joint_torque[:, 0] = -46.0
    result = evaluate_trajectory(made, max_tilt=0.8, max_distance_m=0.3, split=SPLIT)
    assert result.joint_velocity_error_rad_s == pytest.approx(0.1)
    assert result.torque_nm == pytest.approx(2.0)
    assert result.power_w == pytest.approx(2.3 * 46.0)


def test_every_measure_of_the_tables_is_a_number_of_the_result():
    result = evaluate_trajectory(still_trajectory(), max_tilt=0.8, max_distance_m=0.3, split=SPLIT)
    numbers = {name for name, value in result.to_dict().items() if isinstance(value, float)}
    assert numbers - {"duration_s"} == set(MEASURES) - {"latency_ms"}
