"""How far a robot is from its reference in space, in the world and seen from its own pelvis."""

import numpy as np


def body_distance(body_pos_w: np.ndarray, reference_body_pos_w: np.ndarray) -> np.ndarray:
    """Distance of each body from its reference in m: [T, bodies, 3] twice -> [T, bodies]."""
    return np.linalg.norm(body_pos_w - reference_body_pos_w, axis=-1)


def seen_from_the_pelvis(
    body_pos_w: np.ndarray, pelvis: int, root_quat_wxyz: np.ndarray
) -> np.ndarray:
    """Bodies relative to the pelvis, turned by its heading: [T, 27, 3], [T, 4] -> [T, 27, 3].

    ``pelvis`` is its index among the bodies. The origin is the pelvis, x points where it faces, z
    up. A motion that as a whole is shifted or turned about the vertical looks the same; one that
    leans does not.
    """
    relative = body_pos_w - body_pos_w[:, [pelvis]]
    angle = heading(root_quat_wxyz)[:, None]
    cos, sin = np.cos(angle), np.sin(angle)
    x, y, z = np.moveaxis(relative, -1, 0)
    return np.stack((cos * x + sin * y, cos * y - sin * x, z), axis=-1)


def heading(quat_wxyz: np.ndarray) -> np.ndarray:
    """Where the x axis of a frame points on the ground, rad: [T, 4] -> [T]."""
    w, x, y, z = quat_wxyz.T
    return np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))


def tilt(quat_wxyz: np.ndarray) -> np.ndarray:
    """Largest |x| or |y| of gravity's direction in the base frame: [T, 4] -> [T]; 0 is upright."""
    w, x, y, z = quat_wxyz.T
    return 2.0 * np.maximum(np.abs(x * z - w * y), np.abs(y * z + w * x))
