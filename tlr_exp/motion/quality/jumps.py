"""Jumps between frames: accelerations of the root and the joints, from three frames each."""

import numpy as np
from scipy.spatial.transform import Rotation

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
    rotations = Rotation.from_quat(np.array(quats), scalar_first=True)  # read-only ones are refused
    steps = (rotations[:-1].inv() * rotations[1:]).as_rotvec()
    # Both turns are about axes of the frame between them, so that their difference is a vector.
    return np.linalg.norm(np.diff(steps, axis=0), axis=1) * fps**2
