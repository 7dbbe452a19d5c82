"""From a motion file of any known format to a checked ``MotionClip`` at the control rate."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tlr_exp.g1 import CONTROL_DT_S, JOINT_NAMES, TRACKED_BODIES
from tlr_exp.motion.checks import QPOS_JOINTS, ROOT_QUAT
from tlr_exp.motion.clip import MotionClip, body_states, clip_from_qpos, resample
from tlr_exp.motion.importers.detect import MAX_BYTES, READERS, detect, parse
from tlr_exp.motion.importers.raw import (
    MAX_DURATION_S,
    Bodies,
    MotionFileError,
    Options,
    RawMotion,
)
from tlr_exp.motion.joint_limits import beyond_limits, clamp_joints, furthest_beyond
from tlr_exp.motion.quaternions import normalised
from tlr_exp.robot import Robot

CLIP_FPS = round(1 / CONTROL_DT_S)
# Retargeting often leaves joints a little beyond their limits; more than this is another robot.
CLAMP_RAD = 0.2
_COMPARED_FRAMES = 50


@dataclass(frozen=True)
class Clamp:
    """A joint that was set to its limit: by how much at most, and in how many frames."""

    joint: str
    excess_rad: float
    frames: int


@dataclass(frozen=True)
class KinematicsGap:
    """How far a file's body positions are from forward kinematics of our robot."""

    max_m: float
    mean_m: float
    body: str
    frame: int


@dataclass(frozen=True, eq=False)
class Imported:
    """A clip and what was found on the way; ``gap`` is None where a file carries no bodies."""

    clip: MotionClip
    format: str
    raw: RawMotion
    clamps: list[Clamp]
    gap: KinematicsGap | None


def import_motion(
    path: str | Path,
    robot: Robot,
    format: str | None = None,
    options: Options | None = None,
    clamp_rad: float = CLAMP_RAD,
) -> Imported:
    """Read a motion file of any known format.

    Args:
        path: the file, at most ``MAX_BYTES``.
        robot: gives the model and the joint limits.
        format: one of ``READERS``; by default told from the content.
        options: what the file leaves open.
        clamp_rad: how far beyond its limits a joint may be, to be set to the limit.

    Raises:
        MotionFileError: the file cannot be imported; the message names it and says why.
    """
    if not 0 <= clamp_rad < np.pi:
        raise MotionFileError(f"joints cannot be clamped by {clamp_rad:g} rad; expected 0 to pi")
    try:
        raw, found = read_motion(read_bytes(Path(path)), robot, format, options or Options())
        if (len(raw.qpos) - 1) / raw.fps > MAX_DURATION_S:
            raise MotionFileError(f"it is longer than {MAX_DURATION_S / 60:g} minutes")
        gap = kinematics_gap(raw.qpos, raw.bodies, robot) if raw.bodies else None
        qpos, clamps = within_limits(raw.qpos, robot, clamp_rad)
        clip = resample(clip_from_qpos(qpos, raw.fps, robot), CLIP_FPS, robot)
    except ValueError as error:
        text = "".join(c if c.isprintable() else " " for c in str(error))
        raise MotionFileError(f"{path}: {text}") from error
    return Imported(clip, found, raw, clamps, gap)


def read_bytes(path: Path) -> bytes:
    """The content of a file, refused by its size before it is read.

    Raises:
        MotionFileError: there is no such file, it is not a plain one, too large, or unreadable.
    """
    try:
        if not path.exists():
            raise MotionFileError("there is no such file")
        if not path.is_file():
            raise MotionFileError("it is not a plain file")
        size = path.stat().st_size
        if size > MAX_BYTES:
            raise MotionFileError(f"it has {size >> 20} MiB; the limit is {MAX_BYTES >> 20} MiB")
        with path.open("rb") as file:
            return file.read(MAX_BYTES)
    except OSError as error:
        raise MotionFileError(f"it cannot be read: {error.strerror}") from error


def read_motion(
    data: bytes, robot: Robot, format: str | None, options: Options
) -> tuple[RawMotion, str]:
    """The motion of a file's bytes and the name of its format.

    Where a format leaves the joint order open, the order is taken by which the file's body
    positions agree with forward kinematics.

    Raises:
        MotionFileError: see ``import_motion``.
    """
    if format is not None and format not in READERS:
        raise MotionFileError(f"unknown format {format!r}; known are {', '.join(READERS)}")
    content = parse(data)
    found = format or detect(content)
    readings = READERS[found](content, options)
    return _best(readings, robot), found


def _best(readings: list[RawMotion], robot: Robot) -> RawMotion:
    if len(readings) == 1 or np.array_equal(readings[0].qpos, readings[1].qpos):
        return readings[0]
    gaps = []
    for reading in readings:
        step = max(1, len(reading.qpos) // _COMPARED_FRAMES)
        bodies = reading.bodies
        if bodies is None:
            raise MotionFileError("it has no body positions; give --joint-order mujoco or isaac")
        thin = Bodies(bodies.names, bodies.pos_w[::step])
        gaps.append(kinematics_gap(reading.qpos[::step], thin, robot).mean_m)
    first, second = np.argsort(gaps)[:2]
    if gaps[first] > 0.5 * gaps[second]:
        raise MotionFileError(
            f"its body positions fit neither joint order (they are off by {gaps[first]:.3f} m on "
            f"average in the order of {readings[first].joint_order}, {gaps[second]:.3f} m in that "
            f"of {readings[second].joint_order}); give --joint-order"
        )
    return readings[first]


def kinematics_gap(qpos: np.ndarray, bodies: Bodies, robot: Robot) -> KinematicsGap:
    """Compare body positions [T, n, 3] with forward kinematics of ``qpos`` [T, 30]."""
    unit = qpos.copy()
    unit[:, ROOT_QUAT] = normalised(unit[:, ROOT_QUAT])
    ours = body_states(robot, unit, np.zeros((len(qpos), robot.model.nv)))["body_pos_w"]
    columns = [TRACKED_BODIES.index(name) for name in bodies.names]
    distance = np.linalg.norm(ours[:, columns] - bodies.pos_w, axis=-1)
    frame, body = np.unravel_index(distance.argmax(), distance.shape)
    return KinematicsGap(
        float(distance.max()), float(distance.mean()), bodies.names[body], int(frame)
    )


def within_limits(
    qpos: np.ndarray, robot: Robot, clamp_rad: float
) -> tuple[np.ndarray, list[Clamp]]:
    """Set joints that are at most ``clamp_rad`` beyond their limits to the limit.

    Returns:
        [T, 30], and which joints were set.

    Raises:
        MotionFileError: a joint is further beyond.
    """
    joints, limits = qpos[:, QPOS_JOINTS], robot.joint_range_rad
    furthest, words = furthest_beyond(joints, limits)
    if furthest > clamp_rad:
        raise MotionFileError(f"{words}, and at most {clamp_rad:g} rad beyond are set to the limit")
    beyond = beyond_limits(joints, limits)
    clamps = [
        Clamp(name, float(beyond[:, i].max()), int((beyond[:, i] > 0).sum()))
        for i, name in enumerate(JOINT_NAMES)
        if beyond[:, i].max() > 0
    ]
    return clamp_joints(qpos, limits), clamps
