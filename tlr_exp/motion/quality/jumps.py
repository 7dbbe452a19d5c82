"""Jumps between frames: accelerations of the root and the joints, from three frames each."""

import numpy as np

from tlr_exp.motion.checks import QPOS_JOINTS, ROOT_QUAT


def accelerations(qpos: np.ndarray, fps: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Accelerations at the inner frames of ``qpos`` [T, 30].

    A single frame that is off a straight line by d has the acceleration 2 d fps^2 there.

    Returns:
        Of the root's position [T-2] in m/s^2 and orientation [T-2] in rad/s^2 (lengths of
        vectors), and of the joints [T-2, 23] in rad/s^2 (sizes).
    """
    joints = np.abs(np.diff(qpos[:, QPOS_JOINTS], n=2, axis=0)) * fps**2
    root = position_acceleration(qpos[:, :3], fps)
    return root, rotation_acceleration(qpos[:, ROOT_QUAT], fps), joints


def position_acceleration(values: np.ndarray, fps: float) -> np.ndarray:
    """Length of the second difference of [T, n], per second squared; [T-2]."""
    return np.linalg.norm(np.diff(values, n=2, axis=0), axis=1) * fps**2


def rotation_acceleration(quats: np.ndarray, fps: float) -> np.ndarray:
    """The same for orientations [T, 4], in rad/s^2; [T-2]."""
    # Both turns are about axes of the frame between them, so that their difference is a vector.
    return np.linalg.norm(np.diff(rotation_steps(quats), axis=0), axis=1) * fps**2


def rotation_steps(quats: np.ndarray) -> np.ndarray:
    """Rotation vectors [T-1, 3] in radians from each quaternion [T, 4] to the next.

    In the axes of either frame: the axis of a turn is the same before and after it.
    """
    start, end = quats[:-1], quats[1:]
    w = np.sum(start * end, axis=1)
    axis = (
        start[:, :1] * end[:, 1:] - end[:, :1] * start[:, 1:] - np.cross(start[:, 1:], end[:, 1:])
    )
    axis = np.where(w[:, None] < 0, -axis, axis)
    length = np.linalg.norm(axis, axis=1)
    angle = 2 * np.arctan2(length, np.abs(w))
    # For small angles the rotation vector is twice the vector part.
    scale = np.divide(angle, length, out=np.full_like(angle, 2.0), where=length > 1e-12)
    return axis * scale[:, None]
