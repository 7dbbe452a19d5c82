"""The robot, its motion and the environments to train and to evaluate in, from settings."""

import copy
import dataclasses

from tlr_exp import keys
from tlr_exp.assembly.robot import spec_of
from tlr_exp.assembly.seeds import Seeds
from tlr_exp.assembly.split import build_split
from tlr_exp.config.load import ConfigError, instantiate
from tlr_exp.config.settings import EnvSettings, ResetNoise, Settings
from tlr_exp.env.starts import even_frames
from tlr_exp.env.tracking import TrackingEnv
from tlr_exp.motion.authoring.keyframes import load_motion
from tlr_exp.motion.clip import MotionClip, resample
from tlr_exp.motion.reference import Reference
from tlr_exp.robot.model import Robot, build_robot
from tlr_exp.robot.timing import CONTROL_DT_S

LIMIT_MARGIN = 0.1  # epsilon of Table 1, for limit terms that only an evaluation reports


def build_robot_of(settings: EnvSettings, visuals: bool = False) -> Robot:
    """The robot of a configuration, with meshes where pictures are made of it."""
    robot = settings.robot
    return build_robot(robot.mjcf, robot.gains, robot.collisions, visuals, spec_of(settings))


def build_clip(settings: EnvSettings, robot: Robot) -> MotionClip:
    """The motion of a configuration at the control rate."""
    clip = load_motion(settings.motion, robot)
    rate_hz = 1.0 / CONTROL_DT_S
    return clip if clip.fps == rate_hz else resample(clip, rate_hz, robot)


def build_env(settings: Settings, robot: Robot, clip: MotionClip) -> TrackingEnv:
    """The environment that a run trains in."""
    return _build_env(settings, settings.env, robot, clip, settings.scale.num_envs)


def build_evaluation_env(
    settings: Settings,
    robot: Robot,
    clip: MotionClip,
    starts: int = 1,
    key: str = "scale.evaluate_starts",
) -> TrackingEnv:
    """A robot for each of ``starts`` evenly spaced phases, 0 first; no noise, no end by a failure.

    It reports every lower-layer term of the paper, also those that the run's reward has not.

    Raises:
        ConfigError: the motion is too short for so many; ``key`` says where the number comes from.
    """
    settings = copy.deepcopy(settings)
    for name in keys.PAPER_LOWER_LAYER:
        if name not in (*settings.reward.goal, *settings.reward.optimizing):
            settings.reward.optimizing[name] = 0.0
            margins = dict.fromkeys(keys.TERM_PARAMETERS[name], LIMIT_MARGIN)
            settings.reward.parameters[name] = margins
    no_noise = ResetNoise(*(0.0 for _ in dataclasses.fields(ResetNoise)))
    env_settings = dataclasses.replace(settings.env, start_phase="zero", reset_noise=no_noise)
    try:
        frames = even_frames(clip.num_frames - 1 - settings.env.reference_lead, starts, key)
    except ValueError as error:
        raise ConfigError(str(error)) from None
    env = _build_env(settings, env_settings, robot, clip, starts, failures=False)
    env.start_at(frames)
    return env


def _build_env(
    settings: Settings,
    env_settings: EnvSettings,
    robot: Robot,
    clip: MotionClip,
    num_envs: int,
    failures: bool = True,
) -> TrackingEnv:
    reward = settings.reward
    return TrackingEnv(
        physics=instantiate(
            settings.physics, robot=robot, num_envs=num_envs, device=settings.device
        ),
        reference=Reference(clip, settings.device),
        robot=robot,
        terms={name: reward.parameters.get(name, {}) for name in build_split(settings).term_names},
        settings=env_settings,
        seed=Seeds.of(settings.seed).env,
        failures=failures,
    )
