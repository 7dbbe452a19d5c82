"""Our own ``.npz``, as ``MotionClip.save`` writes it."""

from collections.abc import Mapping
from typing import Any

from tlr_exp.motion.importers.raw import (
    Conventions,
    FileBodies,
    Options,
    Recorded,
    take,
    take_named_bodies,
    take_names,
    take_rate,
)
from tlr_exp.robot.spec import RobotSpec


def read(content: Mapping[str, Any], options: Options, spec: RobotSpec) -> Recorded:
    """Positions alone are read; velocities follow from them.

    Raises:
        MotionFileError: see ``raw``.
    """
    names = take_names(content, "joint_names")
    qpos = take(content, "qpos", 7 + len(names))
    position, bodies = take_named_bodies(content, "body_pos_w", "body_names", len(qpos))
    rate = take_rate(content, "fps", options)
    root, quats, joints = qpos[:, :3], qpos[:, 3:7], qpos[:, 7:]
    return Recorded(rate, root, quats, joints, names, Conventions(), FileBodies(position, bodies))
