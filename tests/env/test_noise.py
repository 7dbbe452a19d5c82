"""Noise on what the actor sees: its moments, what it touches and what it leaves alone."""

import dataclasses
import math

import pytest
import torch

from tlr_exp import keys
from tlr_exp.config.settings import ObservationNoise
from tlr_exp.env.instant import Instant
from tlr_exp.env.noise import NoisySensors
from tlr_exp.env.rotations import projected_gravity, rotate, rotate_inverse
from tlr_exp.robot.g1 import G1

NUM_ENVS = 4000
CHANNELS = [f.name for f in dataclasses.fields(ObservationNoise) if f.name != "distribution"]


def sensors(distribution: str = "uniform", seed: int = 0, **noise: float) -> NoisySensors:
    settings = ObservationNoise(distribution, **{**dict.fromkeys(CHANNELS, 0.0), **noise})
    return NoisySensors(settings, G1, seed, torch.device("cpu"))


@pytest.fixture(scope="module")
def instant(random_frame, state_on) -> Instant:
    """Robots in any pose."""
    return Instant(state_on(random_frame(NUM_ENVS)), random_frame(NUM_ENVS, seed=1), G1)


def errors(noisy: Instant, exact: Instant) -> dict[str, torch.Tensor]:
    """What each channel errs by; gravity in the world, about its two horizontal axes."""
    after, before = noisy.state, exact.state
    # The rotation between the two, which is small: twice the imaginary part of its quaternion.
    seen_down = rotate(before.qpos[:, 3:7], projected_gravity(after.qpos[:, 3:7]))
    north = torch.tensor([1.0, 0.0, 0.0]).expand(len(after.qpos), 3)
    turned = rotate(after.qpos[:, 3:7], rotate_inverse(before.qpos[:, 3:7], north))
    velocity = rotate_inverse(after.qpos[:, 3:7], after.qvel[:, :3] - before.qvel[:, :3])
    return {
        "gyro": after.qvel[:, 3:6] - before.qvel[:, 3:6],
        "gravity": seen_down[:, :2],
        "joint_pos": after.qpos[:, 7:] - before.qpos[:, 7:],
        "joint_vel": after.qvel[:, 6:] - before.qvel[:, 6:],
        "heading": turned[:, 1],
        "root_pos": after.qpos[:, :3] - before.qpos[:, :3],
        "root_lin_vel": velocity,
    }


@pytest.mark.parametrize("channel", CHANNELS)
def test_uniform_noise_fills_its_half_width_and_touches_nothing_else(instant, channel):
    found = errors(sensors(**{channel: 0.05})(instant), instant)
    error = found.pop(channel)
    assert 0.049 < error.abs().max() < 0.0501
    assert abs(error.mean()) < 4 * 0.05 / math.sqrt(3 * error.numel())
    assert error.std() == pytest.approx(0.05 / math.sqrt(3), rel=0.04)
    for name, other in found.items():
        # Small rotations commute but for half the product of their angles.
        assert other.abs().max() < 0.6 * 0.05**2, name


@pytest.mark.parametrize("channel", CHANNELS)
def test_gaussian_noise_has_its_standard_deviation(instant, channel):
    error = errors(sensors("gaussian", **{channel: 0.02})(instant), instant)[channel]
    assert error.std() == pytest.approx(0.02, rel=0.05)
    assert abs(error.mean()) < 4 * 0.02 / math.sqrt(error.numel())
    assert error.abs().max() > 0.06  # beyond any uniform noise of that deviation
    within = (error.abs() < 0.02).float().mean()
    assert within == pytest.approx(0.683, abs=0.03)


def test_values_of_one_robot_and_of_several_are_independent(instant):
    found = errors(sensors(gyro=1.0, joint_vel=1.0)(instant), instant)
    both = torch.cat((found["gyro"], found["joint_vel"]), dim=1)
    correlation = torch.corrcoef(both.T) - torch.eye(26)
    assert correlation.abs().max() < 5 / math.sqrt(NUM_ENVS)
    assert len(both[:, 0].unique()) > 0.99 * NUM_ENVS


def test_without_noise_the_instant_itself_is_what_is_seen_and_nothing_is_drawn(instant):
    exact = sensors()
    before = exact.generator.get_state()
    assert exact(instant) is instant
    assert torch.equal(exact.generator.get_state(), before)


def test_the_exact_instant_is_left_as_it_is(instant):
    before = [value.clone() for value in instant.state]
    sensors(**dict.fromkeys(CHANNELS, 0.3))(instant)
    for value, kept in zip(instant.state, before, strict=True):
        assert torch.equal(value, kept)


@pytest.mark.parametrize("observation", ["history", "reference"])
def test_only_the_actor_sees_noise(make_env, observation):
    choices = (f"env.observation={observation}", "env.start_phase=zero")
    exact, noisy = make_env(*choices), make_env(*choices, "env/noise=beyondmimic")
    action = 0.1 * torch.ones(4, 23)
    for env in (exact, noisy):
        env.reset()
    for _ in range(3):
        after, seen = (
            env.step(env.fake_tensordict().set(keys.ACTION, action))["next"]
            for env in (exact, noisy)
        )
        assert (after[keys.OBSERVATION] != seen[keys.OBSERVATION]).any(dim=0).sum() > 50
        for key in (keys.PRIVILEGED, keys.REWARD_TERMS, keys.UPPER_BODY_ERROR):
            assert torch.equal(after[key], seen[key])


def test_noise_is_added_before_the_scales(make_env):
    """Half a rad/s of the gyro is an eighth in the observation, whose scale is 0.25."""
    choices = ("env.observation=history", "env.start_phase=zero")
    noisy = make_env(*choices, "env.noise.gyro=0.5", num_envs=500).reset()[keys.OBSERVATION]
    exact = make_env(*choices, num_envs=500).reset()[keys.OBSERVATION]
    error = (noisy - exact)[:, :75]
    changed = error.abs().amax(dim=0) > 0
    assert changed.nonzero().flatten().tolist() == [46, 47, 48]
    assert 0.12 < error.abs().max() <= 0.12501


def test_a_reset_draws_for_those_that_are_reset_alone(make_env):
    env = make_env("env/noise=asap", "env.start_phase=zero")
    now = env.reset()
    before = env.observed.clone()
    mask = torch.tensor([False, True, False, False])[:, None]
    env.reset(now.set("_reset", mask))
    changed = (env.observed != before).any(dim=1)
    assert changed.tolist() == [False, True, False, False]


def test_the_same_seed_gives_the_same_noise_and_another_seed_another(make_env):
    seen = [
        make_env("env/noise=asap", noise_seed=seed).reset()[keys.OBSERVATION] for seed in (1, 1, 2)
    ]
    assert torch.equal(seen[0], seen[1])
    assert not torch.equal(seen[0], seen[2])


def test_noise_leaves_the_starts_of_episodes_as_they_are(make_env):
    script = torch.randn(30, 4, 23, generator=torch.Generator().manual_seed(0))
    ends = []
    for choices in ((), ("env/noise=asap",)):
        env = make_env(*choices, "env.termination.distance_start_m=0.35")
        now = env.reset()
        for action in script:
            _, now = env.step_and_maybe_reset(now.set(keys.ACTION, action))
        assert env.episode_step.min() < 30  # some began anew
        ends.append((env.start_frame, env.state.qpos))
    assert torch.equal(ends[0][0], ends[1][0])
    assert torch.equal(ends[0][1], ends[1][1])
