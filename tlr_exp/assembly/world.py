"""The robot and its motion, from settings; PyTorch is not loaded for them."""

from tlr_exp.assembly.robot import spec_of
from tlr_exp.config.settings import EnvSettings
from tlr_exp.motion.authoring.keyframes import load_motion
from tlr_exp.motion.clip import MotionClip, resample
from tlr_exp.robot.model import Robot, build_robot
from tlr_exp.robot.timing import CONTROL_DT_S


def build_robot_of(settings: EnvSettings, visuals: bool = False) -> Robot:
    """The robot of a configuration, with meshes where pictures are made of it."""
    robot = settings.robot
    return build_robot(robot.mjcf, robot.gains, robot.collisions, visuals, spec_of(settings))


def build_clip(settings: EnvSettings, robot: Robot) -> MotionClip:
    """The motion of a configuration at the control rate."""
    return resample(load_motion(settings.motion, robot), 1.0 / CONTROL_DT_S, robot)


def num_starts(settings: EnvSettings, clip: MotionClip) -> int:
    """Frames of the motion in which an episode can start, from 0 on.

    The reference is read ahead, and an episode has one step at least.
    """
    return clip.num_frames - 1 - settings.reference_lead
