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

    Files of others that name their joints but leave out the root take it from the pelvis.

    Raises:
        MotionFileError: see ``raw``; or root and pelvis disagree.
    """
    names = take_names(content, "joint_names")
    joints = take(content, "joint_pos", None)
    bodies, pelvis = None, None
    if "body_names" in content:
        body_names = take_names(content, "body_names")
        position = take(content, "body_pos_w", len(body_names), 3, frames=len(joints))
        quats = take(content, "body_quat_w", len(body_names), 4, frames=len(joints))
        bodies = tracked(body_names, position)
        if PELVIS in body_names:
            place = body_names.index(PELVIS)
            pelvis = np.concatenate([position[:, place], quats[:, place]], axis=1)
    if joints.shape[1] == len(names) and pelvis is not None:
        root = pelvis
    else:
        joints = take(content, "joint_pos", 7 + len(names))
        root, joints = joints[:, :7], joints[:, 7:]
        if pelvis is not None:
            root = np.concatenate([root[:, :3], _root(root[:, 3:], pelvis[:, 3:])], axis=1)
    qpos = assemble(root[:, :3], root[:, 3:], joints, names)
    return [RawMotion(take_rate(content, "fps", options), qpos, bodies)]


def _root(quats: np.ndarray, pelvis: np.ndarray) -> np.ndarray:
    """Root quaternions as wxyz; a file that stores them as xyzw shows by its pelvis (wxyz)."""
    if min(np.linalg.norm(quats, axis=-1).min(), np.linalg.norm(pelvis, axis=-1).min()) < 0.5:
        raise MotionFileError("it holds quaternions that are not of unit length")
    for reading in (quats, wxyz(quats)):
        if angle_between(reading, pelvis).max() < _ROOT_TOLERANCE_RAD:
            return reading
    raise MotionFileError("the root of joint_pos and the pelvis of body_quat_w are turned apart")
