"""Unit quaternions wxyz in numpy."""

import numpy as np


def angle_between(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Rotation angle [...] in radians, in [0, pi], between quaternions [..., 4]."""
    first, second = normalised(first), normalised(second)
    second = np.where(np.sum(first * second, axis=-1, keepdims=True) < 0, -second, second)
    gap = np.linalg.norm(second - first, axis=-1)
    return 4 * np.arctan2(gap, np.linalg.norm(second + first, axis=-1))


def continuous(quats: np.ndarray) -> np.ndarray:
    """Unit quaternions whose sign never flips along the first axis; [T, ..., 4]."""
    quats = normalised(quats)
    flips = np.sum(quats[1:] * quats[:-1], axis=-1, keepdims=True) < 0
    quats[1:] *= np.cumprod(np.where(flips, -1.0, 1.0), axis=0)
    return quats


def normalised(quats: np.ndarray) -> np.ndarray:
    """Quaternions [..., 4] scaled to unit norm; those that have it keep every bit."""
    norm = np.linalg.norm(quats, axis=-1, keepdims=True)
    return quats / np.where(np.abs(norm - 1) < 1e-12, 1.0, norm)


def from_euler(yaw: np.ndarray, pitch: np.ndarray, roll: np.ndarray) -> np.ndarray:
    """Quaternions [..., 4] of turns about z, then the new y, then the new x; radians."""
    cy, sy = np.cos(yaw / 2), np.sin(yaw / 2)
    cp, sp = np.cos(pitch / 2), np.sin(pitch / 2)
    cr, sr = np.cos(roll / 2), np.sin(roll / 2)
    return np.stack(
        [
            cy * cp * cr + sy * sp * sr,
            cy * cp * sr - sy * sp * cr,
            cy * sp * cr + sy * cp * sr,
            sy * cp * cr - cy * sp * sr,
        ],
        axis=-1,
    )


def heading(quat: np.ndarray) -> float:
    """The angle about the vertical of a quaternion [4], in radians: where its x axis points."""
    w, x, y, z = quat
    return float(np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z)))


def rotate(quats: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    """Vectors [..., 3] turned by quaternions [..., 4]; the leading shapes broadcast."""
    axis = quats[..., 1:]
    across = 2 * np.cross(axis, vectors)
    return vectors + quats[..., :1] * across + np.cross(axis, across)


def product(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """The turn ``second`` and then ``first``, of quaternions [..., 4]; leading shapes broadcast."""
    w, v = first[..., :1], first[..., 1:]
    x, u = second[..., :1], second[..., 1:]
    scalar = w * x - np.sum(v * u, axis=-1, keepdims=True)
    return np.concatenate([scalar, w * u + x * v + np.cross(v, u)], axis=-1)
