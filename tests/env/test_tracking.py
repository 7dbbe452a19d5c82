"""The environment on the C engine: specs, starts, resets, repeatability, and the collector."""

import dataclasses

import numpy as np
import pytest
import torch
from playback import Playback
from tensordict import TensorDictBase
from torchrl.envs import step_mdp
from torchrl.envs.utils import check_env_specs

from tlr_exp import keys
from tlr_exp.config.limits import ACTIONS
from tlr_exp.env.tracking import TrackingEnv
from tlr_exp.motion.clip import MotionClip, clip_from_qpos
from tlr_exp.motion.reference import Reference

NUM_ENVS = 4


def random_actions(num_steps: int, num_envs: int = NUM_ENVS, seed: int = 0) -> torch.Tensor:
    generator = torch.Generator().manual_seed(seed)
    return 0.5 * torch.randn(num_steps, num_envs, 23, generator=generator)


def advance(env, now: TensorDictBase, action: torch.Tensor) -> tuple[TensorDictBase, ...]:
    """One step and the resets that follow from it, as a collector makes them."""
    return env.step_and_maybe_reset(now.set(keys.ACTION, action))


def run(env, actions: torch.Tensor) -> TensorDictBase:
    """[num_envs, num_steps] of transitions from a fresh start."""
    now, steps = env.reset(), []
    for action in actions:
        step, now = advance(env, now, action)
        steps.append(step)
    return torch.stack(steps, dim=1)


def assert_same_bits(left: TensorDictBase, right: TensorDictBase) -> None:
    assert set(left.keys(True, True)) == set(right.keys(True, True))
    for key in left.keys(True, True):
        assert torch.equal(left[key], right[key]), key


# --- specs -----------------------------------------------------------------------------------


@pytest.mark.parametrize("observation", ["history", "reference"])
@pytest.mark.parametrize("action", ACTIONS)
def test_specs_hold_for_every_choice(make_env, observation, action):
    env = make_env(f"env.observation={observation}", f"env.action={action}")
    check_env_specs(env)
    size = {"history": 376, "reference": 244}[observation]
    now = env.reset()
    assert now[keys.OBSERVATION].shape == (NUM_ENVS, size)
    assert now[keys.PRIVILEGED].shape == (NUM_ENVS, 165)


def test_a_step_reports_raw_terms_and_no_reward(make_env):
    env = make_env()
    step = env.step(env.reset().set(keys.ACTION, torch.zeros(NUM_ENVS, 23)))
    assert set(step["next"].keys()) == {
        *(keys.OBSERVATION, keys.PRIVILEGED, keys.REWARD_TERMS),
        *(keys.FELL, keys.UNSTABLE, keys.PHASE),
        *(keys.UPPER_BODY_ERROR, keys.LOWER_BODY_ERROR, keys.JOINT_ERROR),
        *(keys.TERMINATED, keys.TRUNCATED, keys.DONE),
    }
    assert keys.REWARD not in env.full_reward_spec.keys(True)


# --- starts ----------------------------------------------------------------------------------


def test_an_episode_starts_in_the_state_of_the_reference(make_env, short_clip):
    env = make_env(num_envs=16)
    env.reset()
    start = env.start_frame.numpy()
    assert torch.equal(env.state.qpos, torch.tensor(short_clip.qpos[start], dtype=torch.float32))
    assert torch.equal(env.state.qvel, torch.tensor(short_clip.qvel[start], dtype=torch.float32))
    for name in ("body_pos_w", "body_lin_vel_w", "body_ang_vel_w"):
        expected = getattr(short_clip, name)[start]
        np.testing.assert_allclose(getattr(env.state, name).numpy(), expected, atol=2e-5)


def test_random_starts_cover_the_motion_evenly(make_env):
    env = make_env(num_envs=39 * 60)
    env.reset()
    # An episode needs one step at least, and the reference is read one frame ahead: frames 0..38.
    counts = torch.bincount(env.start_frame)
    assert len(counts) == 39
    # 60 expected in each, with a standard deviation of 7.6.
    assert counts.min() > 30
    assert counts.max() < 90


def test_starts_at_phase_zero(make_env):
    env = make_env("env.start_phase=zero")
    env.reset()
    assert env.start_frame.tolist() == [0] * NUM_ENVS


def test_start_noise_is_applied(make_env, short_clip):
    env = make_env("env.reset_noise.root_pos_m=0.1", "env.reset_noise.joint_vel=0.5", num_envs=64)
    env.reset()
    frames = env.start_frame.numpy()
    moved = np.abs(env.state.qpos.numpy() - short_clip.qpos[frames])
    assert 0.08 < moved[:, :3].max() < 0.1 + 1e-6
    assert moved[:, 3:].max() < 1e-6
    sped = np.abs(env.state.qvel.numpy() - short_clip.qvel[frames])
    assert 0.45 < sped[:, 6:].max() < 0.5 + 1e-6


# --- resets and repeatability ----------------------------------------------------------------


def test_partial_reset_leaves_the_other_environments_bit_for_bit(make_env):
    left_alone, disturbed = make_env(failures=False), make_env(failures=False)
    actions = random_actions(14)
    expected, found = left_alone.reset(), disturbed.reset()
    others = torch.tensor([0, 3])
    for k, action in enumerate(actions):
        if k in (2, 5):
            mask = torch.tensor([False, True, True, False])[:, None]
            found = disturbed.reset(found.set("_reset", mask))
            assert disturbed.episode_step.tolist() == [min(k, 100), 0, 0, k]
            names = (keys.OBSERVATION, keys.PRIVILEGED)
            assert all(torch.equal(found[n][others], expected[n][others]) for n in names)
        before = left_alone.step(expected.set(keys.ACTION, action))
        after = disturbed.step(found.set(keys.ACTION, action))
        assert_same_bits(before["next"][others], after["next"][others])
        expected, found = step_mdp(before), step_mdp(after)
    assert not torch.equal(before["next", keys.OBSERVATION], after["next", keys.OBSERVATION])


def test_the_last_observation_of_an_episode_is_not_that_of_the_next(make_env):
    """``next`` holds the state that an episode ended in; the root holds the new start."""
    env = make_env()
    batch = run(env, random_actions(45))
    done = batch["next", keys.DONE].squeeze(-1)[:, :-1]
    assert done.any(dim=1).all()
    ended, restarted = batch[:, :-1]["next"][done], batch[:, 1:][done]
    assert not (ended[keys.OBSERVATION] == restarted[keys.OBSERVATION]).all(dim=1).any()
    # Five times the same frame, without an action.
    frames = restarted[keys.OBSERVATION][:, :-1].unflatten(1, (5, 75))
    assert (frames == frames[:, :1]).all()
    assert not frames[:, :, 52:].any()
    going_on = batch[:, :-1]["next", keys.OBSERVATION][~done]
    assert torch.equal(going_on, batch[:, 1:][keys.OBSERVATION][~done])


def test_same_seed_same_bits_whatever_the_global_generator(make_env):
    noisy = "env.reset_noise.joint_pos_rad=0.05"
    actions = random_actions(45)
    torch.manual_seed(1)
    first = run(make_env(noisy, seed=3), actions)
    torch.manual_seed(2)
    assert_same_bits(first, run(make_env(noisy, seed=3), actions))
    other = run(make_env(noisy, seed=4), actions)
    assert not torch.equal(first[keys.OBSERVATION], other[keys.OBSERVATION])
    env = make_env(noisy, seed=4)
    env.set_seed(3)
    assert_same_bits(first, run(env, actions))


def test_stepping_touches_no_global_generator(make_env):
    torch.manual_seed(5)
    before = torch.get_rng_state()
    run(make_env("env.reset_noise.joint_pos_rad=0.05"), random_actions(5))
    assert torch.equal(torch.get_rng_state(), before)


# --- what is refused -------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "allowed"),
    [
        ("observation", "history, reference"),
        ("action", "default_pose, current_pose, reference_pose, reference_motion"),
        ("start_phase", "random, adaptive, zero"),
    ],
)
def test_choices_that_do_not_exist_are_refused_with_those_that_do(
    robot, short_clip, settings_of, name, allowed
):
    settings = dataclasses.replace(settings_of().env, **{name: "histroy"})
    reference = Reference(short_clip)
    with pytest.raises(ValueError, match=f"env.{name} is 'histroy'; allowed: {allowed}"):
        TrackingEnv(
            Playback(reference, NUM_ENVS), reference, robot, {"body_pos": {}}, settings, 1, 0
        )


def build(robot, clip: MotionClip, settings) -> TrackingEnv:
    reference = Reference(clip)
    terms = {"base_height": {}}
    return TrackingEnv(Playback(reference, NUM_ENVS), reference, robot, terms, settings, 1, 0)


def test_a_motion_at_another_rate_is_refused(robot, short_clip, settings_of):
    slow = clip_from_qpos(short_clip.qpos, 30.0, robot)
    with pytest.raises(
        ValueError, match=r"30 frames a second, the control rate is 50 Hz: resample"
    ):
        build(robot, slow, settings_of().env)


def test_a_motion_that_is_too_short_is_refused(robot, short_clip, settings_of):
    settings = settings_of("env.reference_lead=2").env
    with pytest.raises(ValueError, match="at least 4 frames, this one has 3"):
        build(robot, clip_from_qpos(short_clip.qpos[:3], 50.0, robot), settings)
    env = build(robot, clip_from_qpos(short_clip.qpos[:4], 50.0, robot), settings)
    step = env.step(env.reset().set(keys.ACTION, torch.zeros(NUM_ENVS, 23)))
    assert step["next", keys.TRUNCATED].all()
