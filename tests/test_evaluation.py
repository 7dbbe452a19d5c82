"""Measures of an evaluation: hand arithmetic, known delays, and a real roll-out."""

import dataclasses
import io
import json
import math

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from rich.console import Console
from tensordict import TensorDict

from tlr_exp import g1, keys
from tlr_exp.evaluate.result_table import result_table
from tlr_exp.evaluation import (
    Trajectory,
    body_distance,
    evaluate_trajectory,
    latency,
    mean_metrics,
    rollout,
    share_before_first,
    tilt,
)
from tlr_exp.mdp.observations import OBSERVATION_DIMS
from tlr_exp.motion.clip import clip_from_qpos
from tlr_exp.networks import build_actor

DT = 0.02


def joint_motion(time_s: np.ndarray) -> np.ndarray:
    """Three joints that move smoothly and without a period within the delays looked for."""
    return np.stack(
        [
            np.sin(1.9 * time_s) + 0.3 * np.sin(4.1 * time_s + 1.0),
            0.5 * np.cos(2.7 * time_s) + 0.1 * time_s,
            0.2 * np.sin(3.3 * time_s + 0.5),
        ],
        axis=1,
    )


def still_trajectory(num_steps: int = 100) -> Trajectory:
    """A robot that stands upright on its reference."""
    qpos = np.zeros((num_steps, 30))
    qpos[:, 3] = 1.0
    bodies = np.zeros((num_steps, len(g1.TRACKED_BODIES), 3))
    return Trajectory(
        control_dt_s=DT,
        qpos=qpos,
        reference_qpos=qpos.copy(),
        body_pos_w=bodies,
        reference_body_pos_w=bodies.copy(),
        terms={"base_height": np.linspace(0.0, 1.0, num_steps)},
        unstable=np.zeros(num_steps, dtype=bool),
    )


# --- latency ---------------------------------------------------------------------------------


@pytest.mark.parametrize("delay_s", [0.0, 0.02, 0.06, 0.3, -0.04, 0.013, 0.047, -0.009])
def test_latency_finds_a_known_delay(delay_s):
    time_s = np.arange(400) * DT
    found = latency(joint_motion(time_s), joint_motion(time_s - delay_s), DT)
    assert found.ms == pytest.approx(1000 * delay_s, abs=0.5)
    assert found.correlation == pytest.approx(1.0, abs=2e-3)
    assert found.reason == ""


@settings(deadline=None, max_examples=30)
@given(st.floats(-0.3, 0.3), st.floats(0.05, 20.0), st.floats(-3.0, 3.0))
def test_latency_ignores_gain_and_offset_of_the_motion(delay_s, gain, offset):
    time_s = np.arange(400) * DT
    found = latency(joint_motion(time_s), gain * joint_motion(time_s - delay_s) + offset, DT)
    assert found.ms == pytest.approx(1000 * delay_s, abs=0.5)


def test_latency_changes_sign_when_reference_and_motion_change_places():
    time_s = np.arange(300) * DT
    early, late = joint_motion(time_s), joint_motion(time_s - 0.05)
    assert latency(early, late, DT).ms == pytest.approx(-latency(late, early, DT).ms, abs=1e-6)


def test_latency_is_that_of_the_joints_that_move():
    time_s = np.arange(300) * DT
    reference, motion = joint_motion(time_s), joint_motion(time_s - 0.04)
    noise = 1e-4 * np.random.default_rng(0).standard_normal((300, 20))
    found = latency(np.hstack((reference, noise)), np.hstack((motion, noise[::-1])), DT)
    assert found.ms == pytest.approx(40.0, abs=0.5)


def test_no_latency_of_a_constant_motion():
    time_s = np.arange(300) * DT
    moving, still = joint_motion(time_s), np.ones((300, 3))
    for reference, motion in ((still, still), (moving, still), (still, moving)):
        found = latency(reference, motion, DT)
        assert found.ms is None
        assert "no joint moves" in found.reason


def test_no_latency_of_unlike_motions():
    rng = np.random.default_rng(0)
    found = latency(rng.standard_normal((400, 3)), rng.standard_normal((400, 3)), DT)
    assert found.ms is None
    assert "correlation" in found.reason


def test_no_latency_beyond_the_longest_delay_looked_for():
    time_s = np.arange(400) * DT
    slow = np.stack([np.sin(0.7 * time_s), np.cos(0.5 * time_s)], axis=1)
    slow_late = np.stack([np.sin(0.7 * (time_s - 0.9)), np.cos(0.5 * (time_s - 0.9))], axis=1)
    found = latency(slow, slow_late, DT)
    assert found.ms is None
    assert "no delay within" in found.reason


def test_no_latency_of_a_short_motion():
    found = latency(joint_motion(np.arange(20) * DT), joint_motion(np.arange(20) * DT), DT)
    assert found.ms is None
    assert "shorter" in found.reason


# --- errors and survival ---------------------------------------------------------------------


def test_body_distance_is_euclidean():
    here = np.zeros((1, 2, 3))
    there = np.array([[[0.3, 0.4, 0.0], [0.0, 0.0, -2.0]]])
    np.testing.assert_allclose(body_distance(here, there), [[0.5, 2.0]])


def test_errors_are_means_over_the_bodies_of_each_half():
    trajectory = still_trajectory()
    # Both hands 0.11 m off all the time: 2 of the 11 upper bodies, none of the lower ones.
    for name in ("left_hand", "right_hand"):
        trajectory.body_pos_w[:, g1.TRACKED_BODIES.index(name), 1] = 0.11
    # The pelvis 0.32 m off in half of the steps: 1 of the 16 lower bodies.
    trajectory.body_pos_w[:50, g1.PELVIS, 2] = 0.32
    trajectory.qpos[:, 7] = 0.23  # one of 23 joints
    result = evaluate_trajectory(trajectory, max_tilt=0.8, max_distance_m=1.0)
    assert result.upper_body_error_m == pytest.approx(0.02)
    assert result.lower_body_error_m == pytest.approx(0.01)
    assert result.joint_error_rad == pytest.approx(0.01)
    assert result.terms == {"base_height": pytest.approx(0.5)}
    assert result.survival == result.upright == 1.0
    assert result.duration_s == pytest.approx(2.0)


@pytest.mark.parametrize(
    ("event", "share"),
    [([False] * 4, 1.0), ([True] + [False] * 3, 0.0), ([False, False, True, False], 0.5)],
)
def test_share_before_first(event, share):
    assert share_before_first(np.array(event)) == share


@pytest.mark.parametrize(
    ("axis", "angle_deg"), [((1, 0, 0), 30), ((0, 1, 0), 30), ((0, 1, 0), -30)]
)
def test_tilt_is_the_sine_of_roll_or_pitch(axis, angle_deg):
    half = math.radians(angle_deg) / 2
    quat = np.array([[math.cos(half), *(math.sin(half) * a for a in axis)]])
    assert tilt(quat)[0] == pytest.approx(0.5)


def test_tilt_ignores_heading():
    half = np.linspace(-np.pi, np.pi, 9) / 2
    zero = np.zeros(9)
    assert tilt(np.stack([np.cos(half), zero, zero, np.sin(half)], axis=1)) == pytest.approx(zero)


def test_a_fall_and_a_stray_body_end_survival_and_only_a_fall_uprightness():
    trajectory = still_trajectory()
    trajectory.body_pos_w[40:45, 3, 0] = 0.31
    trajectory.qpos[70:, 3:7] = [math.sqrt(0.5), math.sqrt(0.5), 0.0, 0.0]  # on its side
    result = evaluate_trajectory(trajectory, max_tilt=0.8, max_distance_m=0.3)
    assert result.survival == pytest.approx(0.40)
    assert result.upright == pytest.approx(0.70)


def test_instability_ends_survival_and_is_counted():
    trajectory = still_trajectory()
    trajectory.unstable[25:] = True
    result = evaluate_trajectory(trajectory, max_tilt=0.8, max_distance_m=0.3)
    assert result.survival == result.upright == pytest.approx(0.25)
    assert result.unstable_steps == 75


# --- output ----------------------------------------------------------------------------------


def test_result_as_json_metrics_and_table():
    result = evaluate_trajectory(still_trajectory(), max_tilt=0.8, max_distance_m=0.3)
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
    result = evaluate_trajectory(still_trajectory(), max_tilt=0.8, max_distance_m=0.3)
    fallen = dataclasses.replace(result, survival=0.25, latency_ms=30.0, terms={"base_height": 1.5})
    means = mean_metrics([result, fallen, dataclasses.replace(fallen, latency_ms=50.0)])
    assert means[keys.EVAL_PREFIX + "survival"] == pytest.approx(0.5)
    assert means[keys.EVAL_SUCCESS] == pytest.approx(1 / 3)
    assert means[keys.EVAL_PREFIX + "latency_ms"] == pytest.approx(40.0)
    assert means[keys.EVAL_PREFIX + keys.REWARD_TERM_PREFIX + "base_height"] == pytest.approx(
        3.5 / 3
    )
    # One roll-out has its own numbers, and no share of successes.
    assert repr(mean_metrics([result])) == repr(result.metrics())
    assert math.isnan(mean_metrics([result, result])[keys.EVAL_PREFIX + "latency_ms"])


# --- roll-out --------------------------------------------------------------------------------


def still_policy(tensordict):
    action = torch.zeros(*tensordict.batch_size, g1.NUM_JOINTS)
    return tensordict.set(keys.ACTION, action)


def evaluation_env(make_env, frames=(0,), **arguments):
    env = make_env("env.start_phase=zero", failures=False, num_envs=len(frames), **arguments)
    env.start_at(frames)
    return env


def test_rollout_follows_the_motion_to_its_end(make_env, short_clip, settings_of):
    env = evaluation_env(make_env)
    names = tuple(settings_of().reward.goal) + tuple(settings_of().reward.optimizing)
    (trajectory,) = rollout(env, still_policy, names)
    lead = env.settings.reference_lead
    assert trajectory.num_steps == short_clip.num_frames - 1 - lead
    # Row k is after step k + 1, with the reference of that instant read `lead` steps ahead.
    np.testing.assert_allclose(trajectory.reference_qpos, short_clip.qpos[1 + lead :], atol=1e-6)
    np.testing.assert_allclose(
        trajectory.reference_body_pos_w, short_clip.body_pos_w[1 + lead :], atol=1e-6
    )
    assert set(trajectory.terms) == set(names)
    assert not trajectory.unstable.any()
    # The last step is the one at which the environment itself calls the motion over.
    env.reset()
    ends = [
        bool(env.step(still_policy(TensorDict({}, batch_size=[1])))["next", keys.TRUNCATED])
        for _ in range(trajectory.num_steps)
    ]
    assert ends == [False] * (trajectory.num_steps - 1) + [True]


def test_measures_agree_with_what_the_environment_reports(make_env, settings_of):
    env = evaluation_env(make_env)
    names = tuple(settings_of().reward.goal) + tuple(settings_of().reward.optimizing)
    (trajectory,) = rollout(env, still_policy, names)
    result = evaluate_trajectory(trajectory, 0.8, 0.3)
    now = env.reset()
    reported = {key: [] for key in (keys.UPPER_BODY_ERROR, keys.LOWER_BODY_ERROR, keys.JOINT_ERROR)}
    terms = []
    for _ in range(result.num_steps):
        after = env.step(still_policy(now))["next"]
        for key, values in reported.items():
            values.append(float(after[key]))
        terms.append(after[keys.REWARD_TERMS][0].numpy())
    upper, lower, joint = (np.mean(values) for values in reported.values())
    assert result.upper_body_error_m == pytest.approx(upper, rel=1e-5)
    assert result.lower_body_error_m == pytest.approx(lower, rel=1e-5)
    assert result.joint_error_rad == pytest.approx(joint, rel=1e-5)
    assert result.terms == pytest.approx(
        dict(zip(names, np.mean(terms, axis=0), strict=True)), rel=1e-5, abs=1e-9
    )


def test_rollout_can_be_cut_short_and_refuses_what_ends_early(make_env, settings_of):
    names = tuple(settings_of().reward.goal) + tuple(settings_of().reward.optimizing)
    (trajectory,) = rollout(evaluation_env(make_env), still_policy, names, num_steps=3)
    assert trajectory.num_steps == 3
    with pytest.raises(ValueError, match="failures=False"):
        rollout(make_env(num_envs=1), still_policy, names)
    with pytest.raises(ValueError, match="1 term names"):
        rollout(evaluation_env(make_env), still_policy, names[:1], num_steps=1)


def test_rollout_uses_the_mean_action_and_no_random_number(make_env, settings_of):
    settings_ = settings_of("ppo.hidden_sizes=[8]", "ppo.initial_std=1.0")
    names = tuple(settings_.reward.goal) + tuple(settings_.reward.optimizing)
    actor = build_actor(
        OBSERVATION_DIMS["history"],
        g1.NUM_JOINTS,
        settings_.ppo,
        torch.Generator().manual_seed(0),
    )
    before = torch.get_rng_state()
    runs = [*(rollout(evaluation_env(make_env), actor, names, num_steps=5)[0] for _ in range(2))]
    np.testing.assert_array_equal(runs[0].qpos, runs[1].qpos)
    assert torch.equal(torch.get_rng_state(), before)


def arrays_of(trajectory):
    names = ("qpos", "reference_qpos", "body_pos_w", "reference_body_pos_w", "unstable")
    return {name: getattr(trajectory, name) for name in names} | trajectory.terms


def test_robots_of_a_batch_do_what_each_does_alone(make_env, settings_of):
    """To the bit with a policy without matrix products, whose rounding may know the batch."""
    names = tuple(settings_of().reward.goal) + tuple(settings_of().reward.optimizing)
    frames = (0, 30, 11)

    def policy(tensordict):
        return tensordict.set(keys.ACTION, 0.3 * torch.sin(tensordict[keys.OBSERVATION][:, :23]))

    together = rollout(evaluation_env(make_env, frames), policy, names)
    assert [trajectory.num_steps for trajectory in together] == [39, 9, 28]
    for frame, in_batch in zip(frames, together, strict=True):
        (alone,) = rollout(evaluation_env(make_env, (frame,)), policy, names)
        for name, values in arrays_of(alone).items():
            np.testing.assert_array_equal(arrays_of(in_batch)[name], values, err_msg=name)


def test_a_network_s_batch_differs_from_single_roll_outs_by_rounding_alone(make_env, settings_of):
    settings_ = settings_of("ppo.hidden_sizes=[64,64]")
    names = tuple(settings_.reward.goal) + tuple(settings_.reward.optimizing)
    generator = torch.Generator().manual_seed(0)
    dim = OBSERVATION_DIMS["history"]
    actor = build_actor(dim, g1.NUM_JOINTS, settings_.ppo, generator)
    frames = tuple(range(0, 32, 2))
    together = rollout(evaluation_env(make_env, frames), actor, names)
    for frame, in_batch in zip(frames, together, strict=True):
        (alone,) = rollout(evaluation_env(make_env, (frame,)), actor, names)
        # Rounding of 1e-7 a step, which contacts amplify; a robot at another's frame is off by cm.
        np.testing.assert_allclose(in_batch.qpos, alone.qpos, rtol=0, atol=1e-3)
        np.testing.assert_allclose(in_batch.body_pos_w, alone.body_pos_w, rtol=0, atol=1e-3)


@pytest.mark.parametrize("frames", [(0,), (0, 39), (-1, 0)])
def test_start_frames_that_do_not_fit_are_refused(make_env, frames):
    with pytest.raises(ValueError, match=r"needed are 2, one for each robot, from 0 to 38"):
        make_env(num_envs=2).start_at(frames)


def test_a_motion_that_is_driven_late_is_found_late_by_as_much(make_env, robot):
    """A policy that aims at the reference as it was six steps ago, and one that is on time."""
    time_s = np.arange(151) * DT
    qpos = np.zeros((151, 30))
    qpos[:, 2], qpos[:, 3] = 0.76, 1.0
    qpos[:, 7:] = robot.default_joint_pos_rad
    for joint, speed in (("left_shoulder_roll", 3.0), ("right_elbow", 4.3)):
        index = 7 + g1.JOINT_NAMES.index(f"{joint}_joint")
        qpos[:, index] += 0.4 * (1 - np.cos(speed * time_s))
    clip = clip_from_qpos(qpos, 1 / DT, robot)

    def delay_of(steps_late: int) -> float:
        env = evaluation_env(make_env, clip=clip)

        def policy(tensordict):
            frame = env.episode_step + env.settings.reference_lead - steps_late
            target = env.reference.frame(frame).qpos[:, 7:]
            action = (target - env.default_joint_pos) / env.action_scale
            return tensordict.set(keys.ACTION, action)

        (trajectory,) = rollout(env, policy, tuple(keys.TERM_NAMES)[: len(env.terms)])
        found = latency(trajectory.reference_qpos[:, 7:], trajectory.qpos[:, 7:], DT)
        assert found.ms is not None, found.reason
        return found.ms

    on_time, late = delay_of(0), delay_of(6)
    assert 0.0 < on_time < 150.0
    assert late - on_time == pytest.approx(120.0, abs=15.0)
