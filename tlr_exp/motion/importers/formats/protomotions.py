"""ProtoMotions: ``.motion`` (one motion) and ``.pt`` (many of them packed), archives of torch.

Bodies are in the order of the project's own model of the robot, which has more of them than ours;
the first is the pelvis. Quaternions are xyzw.
"""

from collections.abc import Mapping
from pathlib import PurePath
from typing import Any

import numpy as np

from tlr_exp.motion.importers.raw import (
    Conventions,
    FileBodies,
    MotionFileError,
    Options,
    Recorded,
    listed,
    take,
    take_rate,
)
from tlr_exp.robot.spec import RobotSpec

_CONVENTIONS = Conventions(quaternion="xyzw", joint_order="mujoco")


def read(content: Mapping[str, Any], options: Options, spec: RobotSpec) -> Recorded:
    """The motion of a ``.motion``.

    Raises:
        MotionFileError: see ``raw``.
    """
    keys = ("dof_pos", "rigid_body_pos", "rigid_body_rot")
    joints, position, quats = _take(content, *keys)
    return _recorded(take_rate(content, "fps", options), joints, position, quats)


def read_library(content: Mapping[str, Any], options: Options, spec: RobotSpec) -> Recorded:
    """The motion of a ``.pt`` whose number (from 0) or file's name is ``options.motion``.

    Raises:
        MotionFileError: see ``raw``; or the file holds several motions and none is chosen.
    """
    joints, position, quats = _take(content, "dps", "gts", "grs")
    lengths = take(content, "motion_num_frames").astype(int)
    number = _choose(content, len(lengths), options)
    ends = np.cumsum(lengths)
    if (lengths < 0).any() or ends[-1] != len(joints):
        raise MotionFileError(f"motion_num_frames do not divide its {len(joints)} frames")
    part = slice(int(ends[number] - lengths[number]), int(ends[number]))
    if options.fps is None:
        step = take(content, "motion_dt", frames=len(lengths))[number]
        if not step > 0:
            raise MotionFileError(f"motion_dt of motion {number} is {step:g} s")
        # Kept in single precision: 1/30 comes back as 29.9999.
        options = Options(fps=float(np.round(1 / step, 3)))
    rate = take_rate({}, "motion_dt", options)
    return _recorded(rate, joints[part], position[part], quats[part])


def _take(
    content: Mapping[str, Any], joints: str, position: str, quats: str
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    dof = take(content, joints, None)
    pos = take(content, position, None, 3, frames=len(dof))
    rot = take(content, quats, pos.shape[1], 4, frames=len(dof))
    if not pos.shape[1]:
        raise MotionFileError(f"{position} has no bodies; the first must be the pelvis")
    return dof, pos, rot


def _recorded(rate: float, joints: np.ndarray, position: np.ndarray, quats: np.ndarray) -> Recorded:
    bodies = FileBodies(position, None)
    return Recorded(rate, position[:, 0], quats[:, 0], joints, None, _CONVENTIONS, bodies)


def _choose(content: Mapping[str, Any], count: int, options: Options) -> int:
    if not count:
        raise MotionFileError("it has no motions")
    files = content.get("motion_files")
    names = [PurePath(str(f)).stem for f in files] if isinstance(files, tuple | list) else []
    asked = options.motion
    if asked is None and count > 1:
        raise MotionFileError(
            f"it has {count} motions; choose one by --motion NUMBER, 0 to {count - 1}"
            + (f", or by its name: {listed(names)}" if names else "")
        )
    if asked is None:
        return 0
    if asked in names[:count]:
        return names.index(asked)
    if asked not in [str(number) for number in range(count)]:
        raise MotionFileError(
            f"it has no motion {asked!r}; it has 0 to {count - 1}"
            + (f": {listed(names)}" if names else "")
        )
    return int(asked)
