"""The environments to train and to evaluate in, from settings."""

import dataclasses
from collections.abc import Mapping
from typing import Any

from tlr_exp.assembly.seeds import Seeds
from tlr_exp.assembly.terms import Terms
from tlr_exp.assembly.world import num_starts
from tlr_exp.config.components import instantiate
from tlr_exp.config.load import ConfigError
from tlr_exp.config.settings import ResetNoise, Settings
from tlr_exp.env.starts import even_frames
from tlr_exp.env.tracking import TrackingEnv
from tlr_exp.motion.clip import MotionClip
from tlr_exp.motion.reference import Reference
from tlr_exp.physics.protocol import Physics
from tlr_exp.robot.model import Robot


def build_env(
    settings: Settings,
    robot: Robot,
    clip: MotionClip,
    terms: Terms,
    saved: Mapping[str, Any] | None = None,
) -> TrackingEnv:
    """The environment that a run trains in; it goes on from a ``saved`` simulation."""
    physics = _physics(settings, robot, settings.scale.num_envs)
    reference, seed = Reference(clip, settings.device), Seeds.of(settings.seed).env
    return TrackingEnv(
        physics,
        reference,
        robot,
        terms,
        settings.env,
        seed,
        potentials=settings.reward.shaping,
        sigma_rate=settings.reward.sigma_rate,
        saved=saved,
    )


def build_evaluation_env(
    settings: Settings,
    robot: Robot,
    clip: MotionClip,
    terms: Terms,
    starts: int = 1,
    key: str = "scale.evaluate_starts",
) -> TrackingEnv:
    """A robot for each of ``starts`` evenly spaced phases, 0 first; no noise, no end by a failure.

    Raises:
        ConfigError: the motion is too short for so many; ``key`` says where the number comes from.
    """
    no_noise = ResetNoise(*(0.0 for _ in dataclasses.fields(ResetNoise)))
    env_settings = dataclasses.replace(settings.env, start_phase="zero", reset_noise=no_noise)
    try:
        frames = even_frames(num_starts(settings.env, clip), starts, key)
    except ValueError as error:
        raise ConfigError(str(error)) from None
    return TrackingEnv(
        _physics(settings, robot, starts),
        Reference(clip, settings.device),
        robot,
        terms,
        env_settings,
        Seeds.of(settings.seed).env,
        failures=False,
        start_frames=frames,
    )


def _physics(settings: Settings, robot: Robot, num_envs: int) -> Physics:
    return instantiate(
        "physics", settings.physics, robot=robot, num_envs=num_envs, device=settings.device
    )
