"""What the environment makes of known motions: reference look-up, errors, ends, phase, actions.

The engine is replaced by one that plays the reference back, so that every number is known.
"""

import math

import numpy as np
import pytest
import torch
from playback import Playback
from torch import Tensor

from tlr_exp import keys
from tlr_exp.config.limits import ACTIONS
from tlr_exp.env.terms import TERMS
from tlr_exp.env.tracking import TrackingEnv
from tlr_exp.motion.reference import Reference
from tlr_exp.physics.state import PhysicsState
from tlr_exp.robot.g1 import G1

NUM_ENVS = 3
LAST_FRAME = 40  # of the short motion
GOAL = ("body_pos", "body_rot", "body_vel", "body_ang_vel")


@pytest.fixture
def playing(robot, short_clip, settings_of):
    """``playing(*overrides, ahead=lead, failures=True, terms=GOAL)``: env on its reference."""

    def make(
        *overrides: str,
        ahead: int | None = None,
        failures: bool = True,
        terms: tuple[str, ...] = GOAL,
    ) -> TrackingEnv:
        settings = settings_of(*overrides).env
        reference = Reference(short_clip)
        return TrackingEnv(
            Playback(reference, NUM_ENVS, settings.reference_lead if ahead is None else ahead),
            reference,
            robot,
            {name: dict.fromkeys(TERMS[name].constants, 0.1) for name in terms},
            settings,
            seed=0,
            failures=failures,
        )

    return make


def step(env: TrackingEnv, action: Tensor | None = None):
    action = torch.zeros(NUM_ENVS, 23) if action is None else action
    return env.step(env.fake_tensordict().set(keys.ACTION, action))["next"]


def errors(after) -> dict[str, list[float]]:
    names = (keys.UPPER_BODY_ERROR, keys.LOWER_BODY_ERROR, keys.JOINT_ERROR)
    return {name: after[name].squeeze(-1).tolist() for name in names}


# --- which reference -------------------------------------------------------------------------


@pytest.mark.parametrize("lead", [0, 1, 4])
def test_a_robot_that_is_the_lead_ahead_tracks_perfectly(playing, lead):
    env = playing(f"env.reference_lead={lead}")
    env.reset()
    for _ in range(int(LAST_FRAME - lead - env.start_frame.max())):
        after = step(env)
        assert (after[keys.REWARD_TERMS] == 1.0).all()
        assert all(value == [0.0] * NUM_ENVS for value in errors(after).values())
    assert after[keys.DONE].any()


def test_a_robot_that_follows_without_lead_is_one_frame_behind(playing, short_clip):
    env = playing(ahead=0)
    env.reset()
    start = env.start_frame.numpy()
    after = step(env)
    gap = short_clip.body_pos_w[start + 2] - short_clip.body_pos_w[start + 1]
    expected = np.linalg.norm(gap, axis=-1)[:, list(G1.upper_body)].mean(axis=1)
    np.testing.assert_allclose(errors(after)[keys.UPPER_BODY_ERROR], expected, atol=1e-6)
    assert expected.min() > 1e-4


def test_terms_stand_in_the_order_of_the_configuration(playing):
    names = ("base_height", "body_pos", "action_smoothness", "termination")
    env = playing(terms=names)
    env.reset()
    env.physics.shift_m[1] = torch.tensor([0.0, 0.0, 0.5])
    env.physics.shift_m[2] = torch.tensor([0.0, 0.0, 2.0])  # beyond the distance limit of 1.5 m
    action = torch.full((NUM_ENVS, 23), 2.0)
    terms = step(env, action)[keys.REWARD_TERMS]
    # Squared: 0.25 and 4 m^2; a third of it over the axes, by sigma 0.1; 23 actions from 0 to 2.
    expected = [
        [0.0, 1.0, 92.0, 0.0],
        [0.25, math.exp(-0.25 / 0.3), 92.0, 0.0],
        [4.0, math.exp(-4 / 0.3), 92.0, 1.0],
    ]
    torch.testing.assert_close(terms, torch.tensor(expected), atol=1e-5, rtol=1e-5)
    # The same action again is no change.
    assert step(env, action)[keys.REWARD_TERMS][:, 2].tolist() == [0.0] * NUM_ENVS


# --- errors ----------------------------------------------------------------------------------


def test_errors_by_hand(playing):
    env = playing()
    env.reset()
    env.physics.shift_m[1] = torch.tensor([0.3, 0.0, 0.4])

    def off(state: PhysicsState) -> PhysicsState:
        # Environment 2: the head is 0.22 m off, the pelvis 0.32 m; two joints 0.23 rad each.
        state.body_pos_w[2, G1.tracked_bodies.index("head"), 1] += 0.22
        state.body_pos_w[2, G1.pelvis, 0] -= 0.32
        state.qpos[2, 7] += 0.23
        state.qpos[2, 20] -= 0.23
        return state

    env.physics.change = off
    found = errors(step(env))
    # Means over 11 upper bodies, 16 lower bodies and 23 joints.
    assert found[keys.UPPER_BODY_ERROR] == pytest.approx([0.0, 0.5, 0.02], abs=1e-6)
    assert found[keys.LOWER_BODY_ERROR] == pytest.approx([0.0, 0.5, 0.02], abs=1e-6)
    assert found[keys.JOINT_ERROR] == pytest.approx([0.0, 0.0, 0.02], abs=1e-6)


# --- ends of episodes ------------------------------------------------------------------------


def ends(after) -> list[tuple[bool, bool, bool]]:
    flags = (keys.TERMINATED, keys.TRUNCATED, keys.DONE)
    return list(zip(*(after[flag].squeeze(-1).tolist() for flag in flags), strict=True))


@pytest.mark.parametrize("lead", [0, 1, 4])
def test_the_end_of_the_motion_truncates(playing, lead):
    env = playing(f"env.reference_lead={lead}", "env.start_phase=zero")
    env.reset()
    for _ in range(LAST_FRAME - lead - 1):
        assert ends(step(env)) == [(False, False, False)] * NUM_ENVS
    assert ends(step(env)) == [(False, True, True)] * NUM_ENVS


def test_every_random_start_leaves_at_least_one_step(playing):
    env = playing("env.reference_lead=30")
    remaining = []
    for _ in range(60):
        env.reset()
        remaining += (LAST_FRAME - 30 - env.start_frame).tolist()
    assert (min(remaining), max(remaining)) == (1, 10)


def lying(env_id: int):
    def change(state: PhysicsState) -> PhysicsState:
        state.qpos[env_id, 3:7] = torch.tensor([0.5**0.5, 0.5**0.5, 0.0, 0.0])
        return state

    return change


def test_a_robot_that_lies_down_has_failed(playing):
    env = playing()
    env.reset()
    env.physics.change = lying(1)
    after = step(env)
    assert ends(after) == [(False,) * 3, (True, False, True), (False,) * 3]
    assert after[keys.FELL].squeeze(-1).tolist() == [False, True, False]


def test_a_robot_that_is_too_far_off_has_failed_without_a_fall(playing):
    env = playing()
    env.reset()
    env.physics.shift_m[1] = 9.0
    after = step(env)
    assert ends(after) == [(False,) * 3, (True, False, True), (False,) * 3]
    assert not after[keys.FELL].any()


def test_a_failure_in_the_last_step_is_no_truncation(playing):
    env = playing("env.start_phase=zero")
    env.reset()
    for _ in range(LAST_FRAME - 2):
        step(env)
    env.physics.change = lying(0)
    assert ends(step(env)) == [(True, False, True), (False, True, True), (False, True, True)]


def test_an_evaluation_goes_on_after_failures(playing):
    env = playing("env.start_phase=zero", failures=False)
    env.reset()
    env.physics.change = lying(0)
    env.physics.shift_m[1] = 9.0
    for _ in range(LAST_FRAME - 2):
        assert ends(step(env)) == [(False, False, False)] * NUM_ENVS
    assert ends(step(env)) == [(False, True, True)] * NUM_ENVS


def test_failures_are_counted_where_in_the_motion_they_happen(playing, robot, short_clip):
    env = playing("env.start_phase=adaptive", "env.reference_lead=1")
    env.reset()
    seen: list[tuple[list[int], list[bool]]] = []
    env.starts.update = lambda frame, failed: seen.append((frame.tolist(), failed.tolist()))
    before = env.physics.frame.tolist()
    env.physics.change = lying(1)
    step(env)
    # The playback says where in the motion it is; the reference that is read ahead does not count.
    assert seen == [([frame + 1 for frame in before], [False, True, False])]


def test_the_distance_limit_tightens_while_episodes_are_long(playing):
    # Each control step with a mean above 38 halves the limit.
    env = playing(
        "env.start_phase=zero",
        "env.termination.distance_start_m=1.6",
        "env.termination.distance_end_m=0.4",
        "env.termination.tighten_rate=0.5",
        "env.termination.tighten_above_steps=38",
        "env.termination.loosen_below_steps=10",
    )
    env.reset()
    env.physics.shift_m[1] = torch.tensor([0.0, 1.0, 0.0])
    # No episode has ended yet, so the mean length is 0 and the limit stays.
    for _ in range(LAST_FRAME - 1):
        assert env.distance.value_m.item() == pytest.approx(1.6)
        assert not step(env)[keys.TERMINATED].any()
    # All three end together after 39 steps: the first halving.
    assert env.distance.value_m.item() == pytest.approx(0.8)
    env.reset()
    # 1 m is too far now. That episode ended after one step: the mean becomes
    # 39 + (1 - 39)/3 = 26.3 steps, and the limit rests.
    assert step(env)[keys.TERMINATED].squeeze(-1).tolist() == [False, True, False]
    assert env.distance.mean_length.item() == pytest.approx(39 - 38 / 3)
    assert env.distance.value_m.item() == pytest.approx(0.8)


# --- observation and action ------------------------------------------------------------------


def test_phase_is_that_of_the_reference_and_ends_at_one(playing):
    env = playing("env.start_phase=zero")
    now = env.reset()
    # The reference is read one frame ahead: frame k + 1 of 40 after k steps.
    assert now[keys.OBSERVATION][:, -1].tolist() == pytest.approx([1 / 40] * NUM_ENVS)
    for k in range(1, LAST_FRAME):
        phase = step(env)[keys.OBSERVATION][:, -1]
        assert phase.tolist() == pytest.approx([(k + 1) / 40] * NUM_ENVS)
    assert (phase == 1.0).all()


def test_history_in_the_environment_is_newest_first_and_repeats_the_first_frame(playing):
    env = playing("env.start_phase=zero")
    default = env.joint_targets.default_pos
    joints = [env.reset()[keys.OBSERVATION][:, :23]]
    assert torch.equal(joints[0], env.state.qpos[:, 7:] - default)
    for k in range(1, 8):
        action = torch.full((NUM_ENVS, 23), float(k))
        frames = step(env, action)[keys.OBSERVATION][:, :-1].unflatten(1, (5, 75))
        joints.append(env.state.qpos[:, 7:] - default)
        for age in range(5):
            past = max(0, k - age)
            assert torch.equal(frames[:, age, :23], joints[past])
            assert (frames[:, age, 52:] == past).all()


def test_the_observed_reference_is_the_one_of_the_next_instant(playing, short_clip):
    env = playing("env.observation=reference", "env.start_phase=zero")
    seen = env.reset()[keys.OBSERVATION]
    for k in range(3):
        # The playback's pelvis stands in the frame of the reference's own pelvis.
        turn = env.state.qpos[0, 3:7].double().numpy()
        at = env.state.qpos[0, :3].double().numpy()
        yaw = 2 * np.arctan2(turn[3], turn[0])
        inverse = np.array(
            [[np.cos(yaw), np.sin(yaw), 0], [-np.sin(yaw), np.cos(yaw), 0], [0, 0, 1]]
        )
        expected = (short_clip.body_pos_w[k + 1] - at) @ inverse.T
        np.testing.assert_allclose(seen[0, 82:163].numpy(), expected.ravel(), atol=1e-5)
        seen = step(env)[keys.OBSERVATION]


@pytest.mark.parametrize("choice", ACTIONS)
def test_joint_targets(playing, robot, short_clip, choice):
    env = playing(f"env.action={choice}", "env.start_phase=zero")
    env.reset()
    before = env.state.qpos[:, 7:].clone()
    action = torch.linspace(-2.0, 2.0, 69).reshape(NUM_ENVS, 23)
    step(env, action)
    coming = short_clip.qpos[:, 7:][1 + 1]  # frame 0, one step later, read one step ahead
    velocity = short_clip.qvel[:, 6:][1 + 1]
    base = {
        "default_pose": robot.default_joint_pos_rad,
        "current_pose": before.double().numpy(),
        "reference_pose": coming,
        "reference_motion": coming + velocity * robot.kd / robot.kp,
    }[choice]
    expected = base + action.double().numpy() * robot.action_scale_rad
    np.testing.assert_allclose(env.physics.targets[0].numpy(), expected, atol=1e-6)
