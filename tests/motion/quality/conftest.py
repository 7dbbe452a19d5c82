"""Clips with one fault each, on a robot that stands."""

import mujoco
import numpy as np
import pytest

from tlr_exp.motion.clip import MotionClip, clip_from_qpos
from tlr_exp.motion.feet import foot_extremes
from tlr_exp.robot.model import Robot

FPS = 50.0


@pytest.fixture(scope="session")
def standing(robot: Robot) -> np.ndarray:
    """[61, 30]: the default pose with its soles on the floor, 1.2 s."""
    pose = np.zeros(30)
    pose[3], pose[7:] = 1.0, robot.default_joint_pos_rad
    data = mujoco.MjData(robot.model)
    data.qpos[:] = pose
    mujoco.mj_kinematics(robot.model, data)
    lowest = []
    for side, body in enumerate(robot.foot_body_ids):
        centres, radii = foot_extremes(robot, side)
        points = data.xpos[body] + centres @ data.xmat[body].reshape(3, 3).T
        lowest.append((points[:, 2] - radii).min())
    pose[2] = -min(lowest)
    return np.tile(pose, (61, 1))


@pytest.fixture(scope="session")
def make_clip(robot: Robot):
    """``make_clip(qpos)``: a clip at 50 Hz."""

    def make(qpos: np.ndarray) -> MotionClip:
        return clip_from_qpos(qpos, FPS, robot)

    return make
