"""ASAP's and PBHC's ``.pkl`` (joblib): named motions, root quaternions xyzw."""

from collections.abc import Mapping
from typing import Any

from tlr_exp.motion.importers.raw import (
    Conventions,
    MotionFileError,
    Options,
    Recorded,
    listed,
    take,
    take_rate,
)
from tlr_exp.robot.spec import RobotSpec


def read(content: Mapping[str, Any], options: Options, spec: RobotSpec) -> Recorded:
    """The motion of the file, or the one that ``options.motion`` names.

    PBHC adds ``contact_mask``, which is not used. ``smpl_joints`` are those of the person, not of
    the robot, so that there is nothing to compare forward kinematics with.

    Raises:
        MotionFileError: see ``raw``; or the file has several motions and none is named.
    """
    motion = choose(content, options)
    dof = take(motion, "dof", spec.num_joints)
    position = take(motion, "root_trans_offset", 3, frames=len(dof))
    quats = take(motion, "root_rot", 4, frames=len(dof))
    rate = take_rate(motion, "fps", options)
    return Recorded(rate, position, quats, dof, spec.joint_names, Conventions(quaternion="xyzw"))


def choose(content: Mapping[str, Any], options: Options) -> Mapping[str, Any]:
    """One of the motions of a file {name: motion}, or the file itself if it is one motion."""
    motions = {name: value for name, value in content.items() if isinstance(value, dict)}
    if not motions:
        return content
    if options.motion is None and len(motions) > 1:
        raise MotionFileError(
            f"it has {len(motions)} motions; choose one by --motion NAME: {listed(motions)}"
        )
    name = next(iter(motions)) if options.motion is None else options.motion
    if name not in motions:
        raise MotionFileError(f"it has no motion {name!r}; it has {listed(motions)}")
    return motions[name]
