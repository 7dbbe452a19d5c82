"""The motion that every reader returns, and the checks that all of them share."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from tlr_exp.errors import UserError

FPS_RANGE = (1.0, 1000.0)
MAX_DURATION_S = 30 * 60.0
MAX_VALUE = 1e9  # of any number: beyond it squares and sums may overflow

_NAMES_SHOWN = 6


class MotionFileError(UserError):
    """A file cannot be imported as a motion; the message says why, in one line."""


class DamagedError(MotionFileError):
    """The bytes of a file are not what they begin as."""


class ImplausibleError(MotionFileError):
    """What a file holds cannot be so as it was read; with other conventions it may well be."""


@dataclass(frozen=True)
class Options:
    """What a file may leave open, or say wrongly; None: as its format has it.

    ``motion`` says which of its motions, ``fps`` its rate; for the others see ``Conventions``.
    ``joint_order`` matters only where a file names no joints. ``anyway`` takes a motion although
    it looks wrong.
    """

    motion: str | None = None
    fps: float | None = None
    joint_order: str | None = None
    units: str | None = None
    quaternion: str | None = None
    up: str | None = None
    angles: str | None = None
    anyway: bool = False


@dataclass(frozen=True)
class Conventions:
    """How the numbers of a file are to be read.

    Attributes:
        units: of positions: ``m``, ``cm`` or ``mm``.
        quaternion: the order of the four, ``wxyz`` or ``xyzw``.
        up: the axis of the world that points up, ``z`` or ``y``.
        angles: of joints: ``rad`` or ``deg``.
        joint_order: of joints without names: ``mujoco`` or ``isaac``; empty where they are named;
            ``open`` where the format does not say.
    """

    units: str = "m"
    quaternion: str = "wxyz"
    up: str = "z"
    angles: str = "rad"
    joint_order: str = ""


@dataclass(frozen=True, eq=False)
class FileBodies:
    """Body positions [T, n, 3] as a file holds them; ``names`` is None where it does not say.

    ``local``: in the frame of the pelvis, rather than of the world.
    """

    pos: np.ndarray
    names: tuple[str, ...] | None
    local: bool = False


@dataclass(frozen=True, eq=False)
class Recorded:
    """What a file holds, before its conventions are applied: what every reader returns.

    Attributes:
        fps: frames a second.
        position: [T, 3], of the pelvis.
        quats: [T, 4], of the pelvis.
        joints: [T, n].
        names: of the n joints, or None.
        conventions: those of the format.
        bodies: body positions that the file carries, if any.
        notes: what the reader took for granted, in words for people.
        told: conventions that the file itself states, which no option changes.
    """

    fps: float
    position: np.ndarray
    quats: np.ndarray
    joints: np.ndarray
    names: tuple[str, ...] | None
    conventions: Conventions
    bodies: FileBodies | None = None
    notes: tuple[str, ...] = ()
    told: frozenset[str] = frozenset()


def thinned(recorded: Recorded, frames: int) -> Recorded:
    """Every so many frames of a file, about ``frames`` in all; the motion stays as fast."""
    step = max(1, len(recorded.joints) // frames)
    bodies = recorded.bodies
    return replace(
        recorded,
        fps=recorded.fps / step,
        position=recorded.position[::step],
        quats=recorded.quats[::step],
        joints=recorded.joints[::step],
        bodies=bodies and FileBodies(bodies.pos[::step], bodies.names, bodies.local),
    )


@dataclass(frozen=True, eq=False)
class Bodies:
    """Body positions in the world, [T, n, 3] in metres.

    ``names`` are among TRACKED_BODIES; None: which body is which is not known, and more may be
    there than the robot's.
    """

    names: tuple[str, ...] | None
    pos_w: np.ndarray


@dataclass(frozen=True, eq=False)
class RawMotion:
    """A motion as a file holds it, in our conventions, at the file's own rate.

    Attributes:
        fps: frames a second.
        qpos: [T, 30] float64: root position (m), orientation wxyz, joints (rad) as JOINT_NAMES.
        bodies: body positions that the file carries, if any.
        conventions: by which it was read.
        notes: what was taken for granted or changed, in words for people.
    """

    fps: float
    qpos: np.ndarray
    bodies: Bodies | None = None
    conventions: Conventions = Conventions()
    notes: tuple[str, ...] = ()

    @property
    def joint_order(self) -> str:
        """By which order nameless joints were read; empty where nothing was open."""
        return self.conventions.joint_order


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
    if options.fps is None and content.get(key) is None:
        raise MotionFileError(f"it does not say its rate (it has no {key}); give --fps")
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


def take_named_bodies(
    content: Mapping[str, Any], key: str, names_key: str, frames: int
) -> tuple[np.ndarray, tuple[str, ...]]:
    """Positions of bodies [frames, bodies, 3] under ``key``, and their names under ``names_key``.

    Raises:
        MotionFileError: see ``take`` and ``take_names``; or not one name for each body.
    """
    names = take_names(content, names_key)
    position = take(content, key, None, 3, frames=frames)
    if position.shape[1] != len(names):
        raise MotionFileError(f"{key} has {position.shape[1]} bodies, {names_key} {len(names)}")
    return position, names


def listed(names: Any) -> str:
    """The first few names, for a message."""
    names = [str(name)[:60] for name in names]
    more = f" and {len(names) - _NAMES_SHOWN} more" if len(names) > _NAMES_SHOWN else ""
    return (", ".join(names[:_NAMES_SHOWN]) or "nothing") + more
