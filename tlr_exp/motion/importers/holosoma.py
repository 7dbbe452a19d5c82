"""holosoma's ``.npz``: the root's seven values and the joints in one array, joints named."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from tlr_exp.motion.importers.raw import (
    MotionFileError,
    Options,
    RawMotion,
    assemble,
    take,
    take_names,
    take_rate,
    tracked,
    wxyz,
)
from tlr_exp.motion.quaternions import angle_between

PELVIS = "pelvis"
_ROOT_TOLERANCE_RAD = 0.05


def read(content: Mapping[str, Any], options: Options) -> list[RawMotion]:
    """The motion; its root orientation is checked against that of the pelvis in the bodies.

    Raises:
        MotionFileError: see ``raw``; or root and pelvis disagree.
    """
    names = take_names(content, "joint_names")
    values = take(content, "joint_pos", 7 + len(names))
    bodies = None
    quats = values[:, 3:7]
    if "body_names" in content:
        body_names = take_names(content, "body_names")
        position = take(content, "body_pos_w", len(body_names), 3, frames=len(values))
        bodies = tracked(body_names, position)
        if PELVIS in body_names:
            poses = take(content, "body_quat_w", len(body_names), 4, frames=len(values))
            quats = _root(quats, poses[:, body_names.index(PELVIS)])
    qpos = assemble(values[:, :3], quats, values[:, 7:], names)
    return [RawMotion(take_rate(content, "fps", options), qpos, bodies)]


def _root(quats: np.ndarray, pelvis: np.ndarray) -> np.ndarray:
    """Root quaternions as wxyz; a file that stores them as xyzw shows by its pelvis (wxyz)."""
    if min(np.linalg.norm(quats, axis=-1).min(), np.linalg.norm(pelvis, axis=-1).min()) < 0.5:
        raise MotionFileError("it holds quaternions that are not of unit length")
    for reading in (quats, wxyz(quats)):
        if angle_between(reading, pelvis).max() < _ROOT_TOLERANCE_RAD:
            return reading
    raise MotionFileError("the root of joint_pos and the pelvis of body_quat_w are turned apart")
