"""BeyondMimic's and mjlab's ``.npz``: nameless joints, and the poses of all bodies.

BeyondMimic writes joints and bodies in the order of Isaac Lab (level by level from the pelvis),
mjlab in that of MuJoCo (limb by limb), under the same keys and shapes; the body positions tell
which it is. Others (UniLab, HDMI) put the world before the robot's bodies, or objects behind them.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np

from tlr_exp.motion.importers.raw import (
    Conventions,
    FileBodies,
    MotionFileError,
    Options,
    Recorded,
    take,
    take_rate,
)
from tlr_exp.robot.spec import RobotSpec


def read(content: Mapping[str, Any], options: Options, spec: RobotSpec) -> Recorded:
    """The motion; the pelvis is the first body that is not the world's origin.

    Raises:
        MotionFileError: see ``raw``.
    """
    joints = take(content, "joint_pos", None)
    position = take(content, "body_pos_w", None, 3, frames=len(joints))
    quats = take(content, "body_quat_w", position.shape[1], 4, frames=len(joints))
    if not position.shape[1]:
        raise MotionFileError("body_pos_w has no bodies; the first must be the pelvis")
    rate = take_rate(content, "fps", options)
    pelvis = _first_that_is_elsewhere(position)
    return Recorded(
        rate,
        position[:, pelvis],
        quats[:, pelvis],
        joints,
        None,
        Conventions(joint_order="open"),
        FileBodies(position[:, pelvis:], None),
        ("bodies before the pelvis that are not used: the world",) if pelvis else (),
    )


def _first_that_is_elsewhere(position: np.ndarray) -> int:
    """Of bodies [T, n, 3], the first that ever leaves the origin (0 if none does)."""
    return int(np.abs(position).max(axis=(0, 2)).astype(bool).argmax())
