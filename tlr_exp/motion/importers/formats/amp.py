"""Isaac Lab's ``.npz`` for adversarial motion priors: joints and bodies named, bodies wxyz."""

from collections.abc import Mapping
from typing import Any

from tlr_exp.motion.importers.raw import (
    Conventions,
    FileBodies,
    MotionFileError,
    Options,
    Recorded,
    listed,
    take,
    take_names,
    take_rate,
)
from tlr_exp.motion.importers.readings.joints import PELVIS, check_joints


def read(content: Mapping[str, Any], options: Options) -> Recorded:
    """The motion; its root is the pelvis among the bodies.

    Raises:
        MotionFileError: see ``raw``; or there is no pelvis.
    """
    names = take_names(content, "dof_names")
    check_joints(names)
    joints = take(content, "dof_positions", len(names))
    body_names = take_names(content, "body_names")
    position = take(content, "body_positions", len(body_names), 3, frames=len(joints))
    quats = take(content, "body_rotations", len(body_names), 4, frames=len(joints))
    if PELVIS not in body_names:
        raise MotionFileError(f"it has no body {PELVIS}; it has {listed(body_names)}")
    root = body_names.index(PELVIS)
    return Recorded(
        take_rate(content, "fps", options),
        position[:, root],
        quats[:, root],
        joints,
        names,
        Conventions(),
        FileBodies(position, body_names),
    )
