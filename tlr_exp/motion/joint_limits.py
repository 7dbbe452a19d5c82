"""Measures how far joints are beyond their limits, and sets them to these."""

import numpy as np

from tlr_exp.errors import UserError
from tlr_exp.motion.checks import QPOS_JOINTS
from tlr_exp.robot.spec import RobotSpec

# Clips retargeted from people often rest on a joint limit or a little beyond it.
LIMIT_TOLERANCE_RAD = 0.05


def beyond_limits(joint_pos: np.ndarray, range_rad: np.ndarray) -> np.ndarray:
    """How far joints [T, 23] are beyond their limits [23, 2], rad; negative inside them."""
    low, high = range_rad.T
    return np.maximum(low - joint_pos, joint_pos - high)


def furthest_beyond(joint_pos: np.ndarray, spec: RobotSpec) -> tuple[float, str]:
    """How far the worst of joints [T, 23] is beyond its limits, rad; and words that name it."""
    beyond = beyond_limits(joint_pos, spec.joint_range_rad)
    frame, joint = np.unravel_index(beyond.argmax(), beyond.shape)
    low, high = spec.joint_range_rad[joint]
    return beyond[frame, joint], (
        f"{spec.joint_names[joint]} is {joint_pos[frame, joint]:.3f} rad at frame {frame}; "
        f"its range is [{low:.3f}, {high:.3f}] rad"
    )


def clamp_joints(qpos: np.ndarray, range_rad: np.ndarray) -> np.ndarray:
    """A copy of configurations [T, 30] with every joint within its limits [23, 2]."""
    clamped = qpos.copy()
    clamped[:, QPOS_JOINTS] = np.clip(qpos[:, QPOS_JOINTS], *range_rad.T)
    return clamped


def check_limits(joint_pos: np.ndarray, spec: RobotSpec) -> None:
    """Refuse joints [T, 23] that are beyond the robot's limits.

    Raises:
        ValueError: names the worst joint.
    """
    beyond, words = furthest_beyond(joint_pos, spec)
    if beyond > LIMIT_TOLERANCE_RAD:
        raise UserError(f"motion clip: {words} (tolerance {LIMIT_TOLERANCE_RAD})")
