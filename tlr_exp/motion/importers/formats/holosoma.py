"""holosoma's ``.npz``: the root's seven values and the joints in one array, joints named."""

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
    take_names,
    take_rate,
)
from tlr_exp.motion.quaternions import angle_between
from tlr_exp.robot.spec import RobotSpec

_ROOT_TOLERANCE_RAD = 0.05


def read(content: Mapping[str, Any], options: Options, spec: RobotSpec) -> Recorded:
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
        bodies = FileBodies(position, body_names)
        if spec.pelvis_name in body_names:
            place = body_names.index(spec.pelvis_name)
            pelvis = np.concatenate([position[:, place], quats[:, place]], axis=1)
    if joints.shape[1] == len(names) and pelvis is not None:
        root = pelvis
    else:
        if joints.shape[1] != 14 + len(names):  # an object's seven values may be behind
            joints = take(content, "joint_pos", 7 + len(names))
        root, joints = joints[:, :7], joints[:, 7 : 7 + len(names)]
        if pelvis is not None:
            root = np.concatenate([root[:, :3], _root(root[:, 3:], pelvis[:, 3:])], axis=1)
    rate = take_rate(content, "fps", options)
    return Recorded(rate, root[:, :3], root[:, 3:], joints, names, Conventions(), bodies)


def _root(quats: np.ndarray, pelvis: np.ndarray) -> np.ndarray:
    """Root quaternions in the order of the pelvis', which a file that stores them otherwise shows.

    The pelvis' are wxyz, unless an option says otherwise.
    """
    if min(np.linalg.norm(quats, axis=-1).min(), np.linalg.norm(pelvis, axis=-1).min()) < 0.5:
        raise MotionFileError("it holds quaternions that are not of unit length")
    for reading in (quats, np.roll(quats, 1, axis=-1)):
        if angle_between(reading, pelvis).max() < _ROOT_TOLERANCE_RAD:
            return reading
    raise MotionFileError("the root of joint_pos and the pelvis of body_quat_w are turned apart")
