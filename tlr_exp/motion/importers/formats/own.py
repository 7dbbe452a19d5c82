"""Our own ``.npz``, as ``MotionClip.save`` writes it."""

from collections.abc import Mapping
from typing import Any

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


def read(content: Mapping[str, Any], options: Options) -> Recorded:
    """Positions alone are read; velocities follow from them.

    Raises:
        MotionFileError: see ``raw``.
    """
    names, bodies = take_names(content, "joint_names"), take_names(content, "body_names")
    qpos = take(content, "qpos", 7 + len(names))
    position = take(content, "body_pos_w", None, 3, frames=len(qpos))
    if position.shape[1] != len(bodies):
        raise MotionFileError(
            f"body_pos_w has {position.shape[1]} bodies, body_names {len(bodies)}"
        )
    rate = take_rate(content, "fps", options)
    root, quats, joints = qpos[:, :3], qpos[:, 3:7], qpos[:, 7:]
    return Recorded(rate, root, quats, joints, names, Conventions(), FileBodies(position, bodies))
