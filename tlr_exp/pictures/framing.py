"""Places a camera so that it has a robot, and its reference, in its pictures."""

from collections.abc import Sequence

import numpy as np

from tlr_exp.motion.checks import ROOT_QUAT
from tlr_exp.motion.quaternions import heading
from tlr_exp.pictures.recording import Recording
from tlr_exp.pictures.render import Camera

# MuJoCo's camera sees this angle from top to bottom; a body reaches so far around its origin.
FIELD_DEG, BODY_M, NEAREST_M = 45.0, 0.15, 2.5
FARTHEST_M = 4.0  # a robot that ran away is rather cut off than all robots made tiny
# The camera follows the pelvis over the floor, and hardly up and down, so that jumps show.
FOLLOW_S, FOLLOW_HEIGHT_S = 0.4, 2.0


def camera_for(
    recording: Recording, lookat: np.ndarray, shown: np.ndarray, aspect: float
) -> tuple[Camera, np.ndarray]:
    """The camera for some states of a recording, and the points [n, 3] in m at which it looks.

    One that a single robot is never cut off by; beside a reference, ``frame_robots``.

    Args:
        recording: the states.
        lookat: about the middle of the picture of each state [T, 3], m.
        shown: the states that there are pictures of [n].
        aspect: width by height of a picture.
    """
    if recording.reference_qpos is not None:
        bodies = [positions[shown] for positions in recording.bodies]
        return frame_robots(bodies, lookat[shown], recording.qpos[shown[0]], aspect)
    return Camera(distance_m=fitting_distance(recording.bodies, lookat, aspect)), lookat[shown]


def camera_path(recording: Recording) -> np.ndarray:
    """The points [T, 3] in m at which a camera looks that goes along.

    They lie between the robot and its reference, at the reference's height, so that a robot that
    falls does not draw the camera down with it and the reference out of the picture.
    """
    robot, reference = recording.qpos, recording.reference_qpos
    reference = robot if reference is None else reference
    path = follow_pelvis((robot[:, :3] + reference[:, :3]) / 2, FOLLOW_S / recording.dt_s)
    path[:, 2] = follow_pelvis(reference, FOLLOW_HEIGHT_S / recording.dt_s)[:, 2]
    return path


def follow_pelvis(qpos: np.ndarray, smoothing_frames: float) -> np.ndarray:
    """The pelvis' path [T, 3] in m, smoothed by a Gaussian window that reflects at both ends."""
    path = np.array(qpos[:, :3], dtype=np.float64)
    if smoothing_frames < 0.1 or len(path) < 2:
        return path
    reach = min(int(np.ceil(3 * smoothing_frames)), len(path) - 1)
    window = np.exp(-0.5 * (np.arange(-reach, reach + 1) / smoothing_frames) ** 2)
    padded = np.pad(path, ((reach, reach), (0, 0)), mode="reflect", reflect_type="odd")
    columns = [np.convolve(padded[:, i], window / window.sum(), mode="valid") for i in range(3)]
    return np.stack(columns, axis=1)


def fitting_distance(bodies: Sequence[np.ndarray], lookat: np.ndarray, aspect: float) -> float:
    """How far in m a camera must be to have all bodies in all its pictures.

    Args:
        bodies: body positions [T, bodies, 3] of each robot, m.
        lookat: the point in the middle of each picture [T, 3], m.
        aspect: width by height of a picture.
    """
    away = [positions - lookat[:, None] for positions in bodies]
    up = max((np.abs(each[..., 2]).max() for each in away), default=0.0) + BODY_M
    aside = max((np.linalg.norm(each[..., :2], axis=-1).max() for each in away), default=0.0)
    reach = max(up, (aside + BODY_M) / aspect)
    return max(NEAREST_M, float(reach / np.tan(np.radians(FIELD_DEG / 2))))


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
