"""The environments to train and to evaluate in, from settings."""

import dataclasses
from collections.abc import Callable, Mapping
from typing import Any

from tlr_exp.assembly.seeds import Seeds
from tlr_exp.assembly.terms import Terms
from tlr_exp.assembly.world import num_starts
from tlr_exp.config.components import instantiate, part_of
from tlr_exp.config.load import ConfigError
from tlr_exp.config.settings import (
    Disturbances,
    EnvSettings,
    ObservationNoise,
    ResetNoise,
    Settings,
)
from tlr_exp.env.disturbances import check_engine
from tlr_exp.env.starts import even_frames
from tlr_exp.env.tracking import TrackingEnv
from tlr_exp.errors import UserError
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
    reference, seeds = Reference(clip, settings.device), Seeds.of(settings.seed)
    return TrackingEnv(
        *(physics, reference, robot, terms, settings.env, seeds.env),
        potentials=settings.reward.shaping,
        sigma_rate=settings.reward.sigma_rate,
        saved=saved,
        noise_seed=seeds.noise,
        disturbance_seed=seeds.disturbance,
    )


def build_evaluation_env(
    settings: Settings,
    robot: Robot,
    clip: MotionClip,
    terms: Terms,
    starts: int = 1,
    key: str = "scale.evaluate_starts",
    disturbed: Callable[[EnvSettings], EnvSettings] = lambda settings: settings,
) -> TrackingEnv:
    """A robot for each of ``starts`` evenly spaced phases, 0 first; no end by a failure.

    Without noise and disturbances, but for those that ``disturbed`` adds. Runs of the same seed
    meet the same ones.

    Raises:
        ConfigError: the motion is too short for so many; ``key`` says where the number comes from.
    """
    exact = dataclasses.replace(undisturbed(settings.env), start_phase="zero")
    settings = dataclasses.replace(settings, env=disturbed(exact))
    seeds = Seeds.of(settings.seed)
    try:
        frames = even_frames(num_starts(settings.env, clip), starts, key)
    except ValueError as error:
        raise ConfigError(str(error)) from None
    return TrackingEnv(
        _physics(settings, robot, starts),
        Reference(clip, settings.device),
        robot,
        terms,
        settings.env,
        seeds.env,
        failures=False,
        start_frames=frames,
        noise_seed=seeds.noise,
        disturbance_seed=seeds.disturbance,
    )


def undisturbed(settings: EnvSettings) -> EnvSettings:
    """The same without noise and disturbances."""
    none = {field.name: 0.0 for field in dataclasses.fields(ObservationNoise)}
    return dataclasses.replace(
        settings,
        reset_noise=ResetNoise(*(0.0 for _ in dataclasses.fields(ResetNoise))),
        noise=ObservationNoise(**{**none, "distribution": settings.noise.distribution}),
        disturbance=Disturbances(*(None for _ in dataclasses.fields(Disturbances))),
    )


def check_disturbance(settings: Settings) -> None:
    """Refuse disturbances that the engine cannot do, without building it, which takes long.

    Raises:
        ConfigError: names their keys and an engine that can.
    """
    try:
        check_engine(settings.env.disturbance, part_of("physics", settings.physics))
    except UserError as error:
        raise ConfigError(str(error)) from error


def _physics(settings: Settings, robot: Robot, num_envs: int) -> Physics:
    check_disturbance(settings)
    return instantiate(
        "physics", settings.physics, robot=robot, num_envs=num_envs, device=settings.device
    )
