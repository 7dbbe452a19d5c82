"""What every importer returns, and the checks that all of them share."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from tlr_exp.g1 import JOINT_NAMES, TRACKED_BODIES
from tlr_exp.motion.checks import UNIT_QUAT_TOLERANCE

FPS_RANGE = (1.0, 1000.0)
MAX_DURATION_S = 30 * 60.0
MAX_POSITION_M = 1000.0
MAX_VALUE = 1e9  # of any number: beyond it squares and sums may overflow

_ARM_ENDS = ("wrist_roll_joint", "wrist_pitch_joint", "wrist_yaw_joint")
# The 29 joints in the order of the robot's model files, the order of Unitree's own data.
JOINT_NAMES_29 = (
    *JOINT_NAMES[:19],
    *(f"left_{name}" for name in _ARM_ENDS),
    *JOINT_NAMES[19:],
    *(f"right_{name}" for name in _ARM_ENDS),
)
# Joints that the 23-joint robot does not have, though a file may: wrists and fingers.
_DROPPED = re.compile(
    r"(left|right)_(wrist_(roll|pitch|yaw)|hand_(thumb|index|middle)_[0-2])_joint"
)
_NAMES_SHOWN = 6


class MotionFileError(ValueError):
    """A file cannot be imported as a motion; the message says why, in one line."""


@dataclass(frozen=True)
class Options:
    """What a file may leave open: which of its motions, its rate, its joint order; None: as read.

    ``joint_order`` is ``mujoco`` or ``isaac`` and matters only where a file names no joints.
    """

    motion: str | None = None
    fps: float | None = None
    joint_order: str | None = None


@dataclass(frozen=True, eq=False)
class Bodies:
    """Body positions that a file carries: names among TRACKED_BODIES, [T, n, 3] in metres."""

    names: tuple[str, ...]
    pos_w: np.ndarray


@dataclass(frozen=True, eq=False)
class RawMotion:
    """A motion as a file holds it, in our conventions, at the file's own rate.

    Attributes:
        fps: frames a second.
        qpos: [T, 30] float64: root position (m), orientation wxyz, joints (rad) as JOINT_NAMES.
        bodies: body positions that the file carries, if any.
        joint_order: by which order nameless joints were read; empty where nothing was open.
    """

    fps: float
    qpos: np.ndarray
    bodies: Bodies | None = None
    joint_order: str = ""


def take(
    content: Mapping[str, Any], key: str, *sizes: int | None, frames: int | None = None
) -> np.ndarray:
    """``content[key]`` as float64 [T, *sizes], None for any size.

    Raises:
        MotionFileError: it is missing, not numeric, not finite, absurdly large, or of another
            shape.
    """
    if key not in content:
        raise MotionFileError(f"it has no {key}; it has {listed(content)}")
    array = content[key]
    if not isinstance(array, np.ndarray) or array.dtype.kind not in "fiu":
        raise MotionFileError(f"{key} is not an array of numbers")
    array = array.astype(np.float64)
    expected = (frames, *sizes)
    fits = array.ndim == len(expected) and all(
        want in (None, got) for want, got in zip(expected, array.shape, strict=True)
    )
    if not fits:
        wanted = ", ".join("any" if size is None else str(size) for size in expected)
        raise MotionFileError(f"{key} has shape {list(array.shape)}; expected [{wanted}]")
    bad = np.argwhere(~(np.abs(array) <= MAX_VALUE))
    if len(bad):
        raise MotionFileError(f"{key}{bad[0].tolist()} is {array[tuple(bad[0])]}")
    return array


def take_rate(content: Mapping[str, Any], key: str, options: Options) -> float:
    """The rate under ``key``, or that of the options.

    Raises:
        MotionFileError: it is missing, no single number, or out of FPS_RANGE.
    """
    value = content.get(key) if options.fps is None else options.fps
    if isinstance(value, np.ndarray) and value.size == 1:
        value = value.reshape(()).item()
    if not isinstance(value, int | float | np.number):
        raise MotionFileError(f"{key} is not one number of frames a second")
    try:
        fps = float(value)
    except OverflowError as error:
        raise MotionFileError(f"{key} is not one number of frames a second") from error
    low, high = FPS_RANGE
    if not low <= fps <= high:
        raise MotionFileError(f"{key} is {fps:g}; expected {low:g} to {high:g} frames a second")
    return fps


def take_names(content: Mapping[str, Any], key: str) -> tuple[str, ...]:
    """The list of names under ``key``.

    Raises:
        MotionFileError: it is missing or no list of texts.
    """
    if key not in content:
        raise MotionFileError(f"it has no {key}; it has {listed(content)}")
    names = content[key]
    if isinstance(names, np.ndarray) and names.dtype.kind in "US" and names.ndim == 1:
        names = [
            n.decode("utf-8", "replace") if isinstance(n, bytes) else n for n in names.tolist()
        ]
    if not isinstance(names, list | tuple) or not all(isinstance(name, str) for name in names):
        raise MotionFileError(f"{key} is not a list of names")
    return tuple(str(name) for name in names)


def nameless(count: int) -> tuple[str, ...]:
    """The names of 23 or 29 joints in the order of the robot's model files.

    Raises:
        MotionFileError: another number.
    """
    for names in (JOINT_NAMES, JOINT_NAMES_29):
        if len(names) == count:
            return names
    raise MotionFileError(f"it has {count} joints; expected 23 or 29")


def assemble(
    root_pos: np.ndarray, root_quat_wxyz: np.ndarray, joints: np.ndarray, names: Sequence[str]
) -> np.ndarray:
    """Configurations [T, 30] from their parts; joints that we do not have are dropped.

    Args:
        root_pos: [T, 3] metres.
        root_quat_wxyz: [T, 4].
        joints: [T, n] rad.
        names: n names of joints.

    Raises:
        MotionFileError: joints unknown, missing or named twice, quaternions not of unit length, a
            root that is kilometres away, fewer than two frames.
    """
    _check_joints(names)
    columns = [names.index(name) for name in JOINT_NAMES]
    if len(joints) < 2:
        raise MotionFileError(f"it has {len(joints)} frame(s); a motion needs at least 2")
    norms = np.linalg.norm(root_quat_wxyz, axis=-1)
    worst = int(np.abs(norms - 1).argmax())
    if abs(norms[worst] - 1) > UNIT_QUAT_TOLERANCE:
        raise MotionFileError(
            f"the root quaternion of frame {worst} has norm {norms[worst]:.4g}; expected 1"
        )
    if np.abs(root_pos).max() > MAX_POSITION_M:
        raise MotionFileError(
            f"the root is {np.abs(root_pos).max():.3g} m from the origin; positions are in metres "
            f"and at most {MAX_POSITION_M:g}"
        )
    return np.concatenate([root_pos, root_quat_wxyz, joints[:, columns]], axis=1)


def tracked(names: Sequence[str], pos_w: np.ndarray) -> Bodies | None:
    """Of body positions [T, n, 3], those of bodies that we know."""
    kept = [name for name in TRACKED_BODIES if name in names]
    if not kept:
        return None
    return Bodies(tuple(kept), pos_w[:, [names.index(name) for name in kept]])


def wxyz(quats_xyzw: np.ndarray) -> np.ndarray:
    """Quaternions [..., 4] with the scalar moved from last to first."""
    return np.roll(quats_xyzw, 1, axis=-1)


def listed(names: Any) -> str:
    """The first few names, for a message."""
    names = [str(name)[:60] for name in names]
    more = f" and {len(names) - _NAMES_SHOWN} more" if len(names) > _NAMES_SHOWN else ""
    return (", ".join(names[:_NAMES_SHOWN]) or "nothing") + more


def _check_joints(names: Sequence[str]) -> None:
    unknown = [n for n in names if n not in JOINT_NAMES and not _DROPPED.fullmatch(n)]
    missing = [n for n in JOINT_NAMES if n not in names]
    twice = sorted({n for n in names if names.count(n) > 1})
    faults = (("unknown joints", unknown), ("missing joints", missing), ("twice", twice))
    text = "; ".join(f"{what}: {listed(found)}" for what, found in faults if found)
    if text:
        raise MotionFileError(f"its joints are not those of the G1; {text}")
