"""Whether a motion keeps its balance, measured apart from how it was planned."""

import numpy as np

from tlr_exp.motion.clip import MotionClip
from tlr_exp.motion.dynamics import centroidal
from tlr_exp.motion.feet import half_planes
from tlr_exp.robot.model import Robot


def zero_moment_point(clip: MotionClip, robot: Robot) -> np.ndarray:
    """Where the floor's reaction acts, [T, 2] in metres; NaN where the robot weighs nothing.

    With F = m (c'' + g e_z) and H the angular momentum about the centre of mass c:
    x = c_x - (c_z F_x + H'_y) / F_z and y = c_y - (c_z F_y - H'_x) / F_z.
    """
    motion = centroidal(clip, robot)
    force = motion.mass * np.gradient(motion.com_vel, 1 / clip.fps, axis=0)
    force[:, 2] -= motion.mass * robot.model.opt.gravity[2]
    spin = np.gradient(motion.angular_momentum, 1 / clip.fps, axis=0)
    weight = np.where(force[:, 2] > motion.mass, force[:, 2], np.nan)
    x = motion.com[:, 0] - (motion.com[:, 2] * force[:, 0] + spin[:, 1]) / weight
    y = motion.com[:, 1] - (motion.com[:, 2] * force[:, 1] - spin[:, 0]) / weight
    return np.stack([x, y], axis=1)


def support_margin(points: np.ndarray, position: np.ndarray) -> float:
    """How far ``position`` [2] lies inside the convex hull of ``points`` [n, 2], in metres.

    Negative outside, where its size is at most the distance to the hull.
    """
    planes = half_planes(points)
    return float(-(planes[:, :2] @ position + planes[:, 2]).max())
