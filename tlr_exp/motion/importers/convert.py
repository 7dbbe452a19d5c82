"""From a motion file of any known format to a checked ``MotionClip`` at the control rate."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from tlr_exp.motion.checks import QPOS_JOINTS
from tlr_exp.motion.clip import MotionClip, clip_from_qpos, resample
from tlr_exp.motion.importers.detect import READERS, detect
from tlr_exp.motion.importers.files import containers
from tlr_exp.motion.importers.raw import (
    MAX_DURATION_S,
    ImplausibleError,
    MotionFileError,
    Options,
    RawMotion,
)
from tlr_exp.motion.importers.readings.conventions import of_options
from tlr_exp.motion.importers.readings.kinematics import KinematicsGap, kinematics_gap, with_order
from tlr_exp.motion.importers.readings.metadata import with_metadata
from tlr_exp.motion.importers.readings.plausible import check_plausible, likely_reading, suggestion
from tlr_exp.motion.joint_limits import beyond_limits, clamp_joints, furthest_beyond
from tlr_exp.robot.model import Robot
from tlr_exp.robot.timing import CONTROL_DT_S

CLIP_FPS = round(1 / CONTROL_DT_S)
# Retargeting often leaves joints a little beyond their limits; more than this is another robot.
CLAMP_RAD = 0.2


@dataclass(frozen=True)
class Clamp:
    """A joint that was set to its limit: by how much at most, and in how many frames."""

    joint: str
    excess_rad: float
    frames: int


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
        path: the file, at most ``containers.MAX_BYTES``.
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
        raw, found = read_motion(Path(path), robot, format, options or Options(), clamp_rad)
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
        if size > containers.MAX_BYTES:
            raise MotionFileError(
                f"it has {size >> 20} MiB; the limit is {containers.MAX_BYTES >> 20} MiB"
            )
        with path.open("rb") as file:
            return file.read(containers.MAX_BYTES)
    except OSError as error:
        raise MotionFileError(f"it cannot be read: {error.strerror}") from error


def read_motion(
    path: Path, robot: Robot, format: str | None, options: Options, clamp_rad: float
) -> tuple[RawMotion, str]:
    """The motion of a file and the name of its format.

    Where a format leaves the joint order open, the order is taken by which the file's body
    positions agree with forward kinematics. What does not look like a robot on a floor is refused.

    Raises:
        MotionFileError: see ``import_motion``.
    """
    if format is not None and format not in READERS:
        raise MotionFileError(f"unknown format {format!r}; known are {', '.join(READERS)}")
    content, notes = with_metadata(containers.parse(read_bytes(path)), path)
    found = format or detect(content)
    recorded = READERS[found](content, options, robot.spec)
    recorded = replace(recorded, notes=(*notes, *recorded.notes))
    conventions = of_options(recorded, options)
    try:
        raw = with_order(recorded, conventions, robot)
    except ImplausibleError as error:
        likely = likely_reading(recorded, conventions, robot, options, clamp_rad)
        if likely is None:
            raise
        raise MotionFileError(f"{error}; {suggestion(conventions, likely[0])}") from error
    check_plausible(recorded, raw, robot, options, clamp_rad)
    return raw, found


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
    furthest, words = furthest_beyond(joints, robot.spec)
    if furthest > clamp_rad:
        raise MotionFileError(f"{words}, and at most {clamp_rad:g} rad beyond are set to the limit")
    beyond = beyond_limits(joints, limits)
    clamps = [
        Clamp(name, float(beyond[:, i].max()), int((beyond[:, i] > 0).sum()))
        for i, name in enumerate(robot.spec.joint_names)
        if beyond[:, i].max() > 0
    ]
    return clamp_joints(qpos, limits), clamps
