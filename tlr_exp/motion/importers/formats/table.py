"""Tables: Unitree's retargeted LAFAN1 and whatever looks like it, and BONES-SEED's.

Without names, the columns are those of LAFAN1: position, quaternion xyzw, 29 or 23 joints, perhaps
behind the time or the frame's number. With names, their order does not matter.
"""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from tlr_exp.motion.importers.files.text_table import COLUMNS, TABLE
from tlr_exp.motion.importers.raw import (
    Conventions,
    MotionFileError,
    Options,
    Recorded,
    listed,
    take,
    take_rate,
)
from tlr_exp.motion.importers.readings.columns import Columns, understand
from tlr_exp.motion.importers.readings.conventions import LARGEST_RAD
from tlr_exp.motion.importers.readings.table_time import rate_of_steps
from tlr_exp.motion.quaternions import from_euler
from tlr_exp.robot.spec import RobotSpec

FPS = 30.0
_ROOT = 7
_OTHER_ROBOTS = {_ROOT + 19: "H1 (19 joints)", _ROOT + 27: "H1-2 (27 joints)"}
_LAFAN1 = Conventions(quaternion="xyzw", joint_order="mujoco")
_NO_RATE = f"a table of this kind does not say its rate: {FPS:g} taken, as Unitree's have"


def read(content: Mapping[str, Any], options: Options, spec: RobotSpec) -> Recorded:
    """The motion of a table, at the rate of its times, ``options.fps``, or LAFAN1's 30.

    Raises:
        MotionFileError: see ``raw``; or the columns are not understood, or those of another robot.
    """
    table = take(content, TABLE, None)
    names = content.get(COLUMNS)
    columns = understand(names, spec) if names else Columns()
    if columns.joints:
        return _named(table, columns, options)
    notes = ("its line of names names no joints: read in Unitree's order",) if names else ()
    return _nameless(table, options, spec, notes)


def _nameless(
    table: np.ndarray, options: Options, spec: RobotSpec, notes: tuple[str, ...]
) -> Recorded:
    width = table.shape[1]
    counts = (len(spec.model_joint_names), spec.num_joints)
    steps = None
    if width - 1 - _ROOT in counts:
        steps, table = table[:, 0], table[:, 1:]
    elif width - _ROOT not in counts:
        raise MotionFileError(_of_width(width, spec.name, *counts))
    rate, said = _rate(steps, "its first column", options)
    root, quats, joints = np.split(table, [3, _ROOT], axis=1)
    return Recorded(rate, root, quats, joints, None, _LAFAN1, notes=(*notes, *said))


def _of_width(width: int, name: str, many: int, few: int) -> str:
    for robot_width, robot in _OTHER_ROBOTS.items():
        if width in (robot_width, robot_width + 1):
            return (
                f"it has {width} columns: that is a table of Unitree's {robot}, not of the {name} "
                f"({_ROOT + many} columns, or {_ROOT + few} with {few} joints)"
            )
    if width in (many, few):
        return f"it has {width} columns: joints alone, without the root's seven columns"
    return (
        f"it has {width} columns; expected {_ROOT + many} (x y z, qx qy qz qw, {many} joints) or "
        f"{_ROOT + few} ({few} joints), perhaps behind one of time, or a line with the names of "
        "the columns"
    )


def _named(table: np.ndarray, columns: Columns, options: Options) -> Recorded:
    position = _three(table, columns.position, "position of the root", "x y z")
    names = tuple(columns.joints)
    joints = table[:, list(columns.joints.values())]
    conventions = Conventions(
        units="cm" if columns.seed else "m",
        angles="deg" if columns.degrees or (columns.seed and columns.degrees is None) else "rad",
    )
    notes = []
    if set(columns.quaternion) == set("wxyz"):
        quats = table[:, [columns.quaternion[letter] for letter in "wxyz"]]
    else:
        angles = _three(table, columns.euler, "orientation of the root", "x y z of Euler angles")
        if columns.degrees is None and not columns.seed and options.angles is None:
            largest = np.abs(np.hstack([angles, joints])).max()
            if largest > LARGEST_RAD:
                conventions = replace(conventions, angles="deg")
                notes.append(f"angles reach {largest:.0f}: taken as degrees")
        degrees = (options.angles or conventions.angles) == "deg"
        angles = np.radians(angles) if degrees else angles
        quats = from_euler(angles[:, 2], angles[:, 1], angles[:, 0])
        notes.append("the root's Euler angles turn about the fixed axes x, y, z in this order")
    unused = [*columns.unused, *columns.unknown]
    notes += [f"columns that are not used: {listed(unused)}"] if unused else []
    where = columns.time if columns.time is not None else columns.frame
    steps = None if where is None else table[:, where]
    if columns.seed and columns.time is None:
        rate, said = _rate_of_seed(options), ()
    else:
        rate, said = _rate(steps, "its column of times", options)
    # Letters and Euler angles leave nothing open.
    told, notes = frozenset({"quaternion"}), [*notes, *said]
    return Recorded(rate, position, quats, joints, names, conventions, None, tuple(notes), told)


def _three(table: np.ndarray, found: Mapping[str, int], what: str, wanted: str) -> np.ndarray:
    if set(found) != set("xyz"):
        raise MotionFileError(
            f"it names joints, but not the {what} ({wanted}); found: {listed(sorted(found))}"
        )
    return table[:, [found[letter] for letter in "xyz"]]


def _rate_of_seed(options: Options) -> float:
    if options.fps is None:
        raise MotionFileError(
            "it does not say its rate; give --fps (BONES-SEED's own tables have 120)"
        )
    return take_rate({}, "fps", options)


def _rate(steps: np.ndarray | None, what: str, options: Options) -> tuple[float, tuple[str, ...]]:
    """The rate of a table, and what is to be said of where it comes from."""
    if options.fps is not None:
        return take_rate({}, "fps", options), ()
    found = None if steps is None else rate_of_steps(steps, what)
    if found is None:
        return FPS, (_NO_RATE,)
    return take_rate({"the rate": found}, "the rate", replace(options, fps=None)), ()
