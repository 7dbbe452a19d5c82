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
from tlr_exp.motion.importers.readings.joints import check_joints
from tlr_exp.robot.spec import RobotSpec


def read(content: Mapping[str, Any], options: Options, spec: RobotSpec) -> Recorded:
    """The motion; its root is the pelvis among the bodies.

    Raises:
        MotionFileError: see ``raw``; or there is no pelvis.
    """
    names = take_names(content, "dof_names")
    check_joints(names, spec)
    joints = take(content, "dof_positions", len(names))
    body_names = take_names(content, "body_names")
    position = take(content, "body_positions", len(body_names), 3, frames=len(joints))
    quats = take(content, "body_rotations", len(body_names), 4, frames=len(joints))
    if spec.pelvis_name not in body_names:
        raise MotionFileError(f"it has no body {spec.pelvis_name}; it has {listed(body_names)}")
    root = body_names.index(spec.pelvis_name)
    return Recorded(
        take_rate(content, "fps", options),
        position[:, root],
        quats[:, root],
        joints,
        names,
        Conventions(),
        FileBodies(position, body_names),
    )
