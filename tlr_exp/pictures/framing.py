"""Where a camera must be to have a robot and its reference in its pictures."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tlr_exp.pictures.clip_pictures import BODY_M, FIELD_DEG, NEAREST_M
from tlr_exp.pictures.render import Camera, heading_deg

FARTHEST_M = 3.6  # a robot that ran away is rather cut off than all robots made tiny


def camera_for(
    bodies: Sequence[np.ndarray], lookat: np.ndarray, first_qpos: np.ndarray, aspect: float
) -> Camera:
    """The usual camera, as far away as all robots need, within limits.

    Args:
        bodies: body positions of each robot [n, bodies, 3], m.
        lookat: the middle of each picture [n, 3], m.
        first_qpos: the state [30] of the first picture, to whose heading the camera is relative.
        aspect: width by height of a picture.
    """
    usual = Camera()
    azimuth_deg = usual.azimuth_deg + heading_deg(first_qpos)
    return Camera(distance_m=fitting_distance(bodies, lookat, azimuth_deg, aspect))


def fitting_distance(
    bodies: Sequence[np.ndarray], lookat: np.ndarray, azimuth_deg: float, aspect: float
) -> float:
    """How far away in m a camera has all robots in its pictures, within limits.

    Args:
        bodies, lookat, aspect: as ``camera_for``.
        azimuth_deg: where the camera looks, in the world: 0 along x, 90 along y.
    """
    away = np.stack(list(bodies)) - lookat[:, None]
    up = np.abs(away[..., 2]).max() + BODY_M
    azimuth = np.radians(azimuth_deg)
    aside = np.abs(away[..., :2] @ [np.sin(azimuth), -np.cos(azimuth)]).max() + BODY_M
    needed = max(up, aside / aspect) / np.tan(np.radians(FIELD_DEG / 2))
    return float(np.clip(needed, NEAREST_M, FARTHEST_M))
