"""LocoMuJoCo's ``.npz`` before 1.0: an array a joint, the root as six joints of their own.

Its robot is the first model of the G1, of 2024: one joint in the waist, other angles at which the
joints of a leg are zero, hips 3 cm shorter. Angles and height are carried over to today's model, so
that thighs, shanks and feet point where they did.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np

from tlr_exp.motion.importers.formats.locomujoco import choose_part
from tlr_exp.motion.importers.raw import (
    Conventions,
    MotionFileError,
    Options,
    Recorded,
    listed,
    take,
    take_rate,
)
from tlr_exp.motion.quaternions import product
from tlr_exp.robot.spec import RobotSpec

_ROOT = ("tx", "tz", "ty", "tilt", "list", "rotation")
_PREFIX = "q_"
# The root's height is counted from that of the model's pelvis.
_PELVIS_M, _SHORTER_M = 0.755, 0.030
_HEIGHTS_FROM_PELVIS_M = 0.4
_OLD_JOINTS = {"torso_joint": "waist_yaw_joint"}
_OLD_JOINTS |= {f"{s}_elbow_pitch_joint": f"{s}_elbow_joint" for s in ("left", "right")}
_OLD_JOINTS |= {f"{s}_elbow_roll_joint": f"{s}_wrist_roll_joint" for s in ("left", "right")}
# Added to an old angle: the links of the old model are turned by -20, 29.2 and -9.2 degrees where
# today's are by -10, 10 and 0 (degrees to the precision of the model files).
_ADDED_DEG = {"hip_pitch": -9.978, "knee": 19.177, "ankle_pitch": -9.198}


def read(content: Mapping[str, Any], options: Options, spec: RobotSpec) -> Recorded:
    """The trajectory, or the one whose number (from 0) is ``options.motion``.

    Raises:
        MotionFileError: see ``raw``; the file does not say its rate, or is of another robot.
    """
    keys = [key for key in content if key.startswith(_PREFIX)]
    frames = len(take(content, f"{_PREFIX}pelvis_tx"))
    part = choose_part(content, frames, options)
    root = np.stack(
        [take(content, f"{_PREFIX}pelvis_{name}", frames=frames)[part] for name in _ROOT], axis=1
    )
    names = [key.removeprefix(_PREFIX) for key in keys if not key.startswith("q_pelvis_")]
    joints = np.stack([take(content, _PREFIX + n, frames=frames)[part] for n in names], axis=1)
    old = "torso_joint" in names
    if old and not set(_OLD_JOINTS) <= set(names):
        raise MotionFileError(
            f"its joints are not those of the {spec.name}; it has {listed(names)}"
        )
    notes = []
    position = root[:, :3].copy()
    if len(root) and abs(np.median(position[:, 2])) < _HEIGHTS_FROM_PELVIS_M:
        position[:, 2] += _PELVIS_M
        notes.append(f"heights counted from those of the model's pelvis, {_PELVIS_M:g} m")
    if old:
        position[:, 2] += _SHORTER_M
        names, joints = _todays(names, joints)
        notes.append("the first model of the G1: angles of hips, knees and ankles carried over")
    if options.fps is None:
        raise MotionFileError(
            "it does not say its rate; give --fps (LocoMuJoCo's recordings of people have 500)"
        )
    rate = take_rate({}, "fps", options)
    quats = _orientation(*root[:, 3:].T)
    return Recorded(rate, position, quats, joints, tuple(names), Conventions(), notes=tuple(notes))


def _todays(names: list[str], joints: np.ndarray) -> tuple[list[str], np.ndarray]:
    """Joints of the old model as those of today's; the waist has no roll and pitch."""
    joints = joints.copy()
    names = [_OLD_JOINTS.get(name, name) for name in names]
    for i, name in enumerate(names):
        for part, added in _ADDED_DEG.items():
            if f"_{part}_joint" in name:
                joints[:, i] += np.radians(added)
    straight = np.zeros((len(joints), 2))
    return [*names, "waist_roll_joint", "waist_pitch_joint"], np.hstack([joints, straight])


def _orientation(tilt: np.ndarray, roll: np.ndarray, yaw: np.ndarray) -> np.ndarray:
    """Quaternions [T, 4] of turns about -y, then the new x, then the new z."""
    none = np.zeros_like(tilt)
    about_y = np.stack([np.cos(tilt / 2), none, -np.sin(tilt / 2), none], axis=1)
    about_x = np.stack([np.cos(roll / 2), np.sin(roll / 2), none, none], axis=1)
    about_z = np.stack([np.cos(yaw / 2), none, none, np.sin(yaw / 2)], axis=1)
    return product(product(about_y, about_x), about_z)
