"""Where a camera must be to have a robot and its reference in its pictures."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tlr_exp.motion.checks import ROOT_QUAT
from tlr_exp.motion.quaternions import heading
from tlr_exp.pictures.clip_pictures import BODY_M, FIELD_DEG, NEAREST_M
from tlr_exp.pictures.render import Camera

FARTHEST_M = 4.0  # a robot that ran away is rather cut off than all robots made tiny


def frame_robots(
    bodies: Sequence[np.ndarray], lookat: np.ndarray, first_qpos: np.ndarray, aspect: float
) -> tuple[Camera, np.ndarray]:
    """A camera that has all robots in its pictures as large as can be, the reference in any case.

    Args:
        bodies: body positions [n, bodies, 3] of the reference, then of others, m.
        lookat: about the middle of each picture [n, 3], m.
        first_qpos: the state [30] of the first picture, to whose heading the camera is relative.
        aspect: width by height of a picture.

    Returns:
        The usual camera at the distance needed, within limits; and ``lookat``, all of it moved by
        the same vector, at right angles to where the camera looks.
    """
    azimuth = np.radians(Camera().azimuth_deg) + heading(first_qpos[ROOT_QUAT])
    right, up = np.array([np.sin(azimuth), -np.cos(azimuth), 0.0]), np.array([0.0, 0.0, 1.0])
    away = [body - lookat[:, None] for body in bodies]
    aside, height = ([positions @ axis for positions in away] for axis in (right, up))
    slope = np.tan(np.radians(FIELD_DEG / 2))
    needed = max(_half(height), _half(aside) / aspect) / slope
    distance_m = float(np.clip(needed, NEAREST_M, FARTHEST_M))
    reach = distance_m * slope - BODY_M
    shift = _middle(aside, aspect * (reach + BODY_M) - BODY_M) * right
    shift += _middle(height, reach) * up
    return Camera(distance_m=distance_m), lookat + shift


def _half(values: Sequence[np.ndarray]) -> float:
    """Half of the room that all need."""
    return float(max(map(np.max, values)) - min(map(np.min, values))) / 2 + BODY_M


def _middle(values: Sequence[np.ndarray], reach: float) -> float:
    """The middle of all, or so near to it that all of the first are within ``reach``."""
    middle = float(max(map(np.max, values)) + min(map(np.min, values))) / 2
    low, high = values[0].max() - reach, values[0].min() + reach
    return float(np.clip(middle, low, high)) if low < high else float(low + high) / 2
