"""GMR's ``.pkl``: root quaternions xyzw, body positions in the frame of the pelvis."""

from collections.abc import Mapping
from typing import Any

from tlr_exp.motion.importers.raw import (
    Bodies,
    MotionFileError,
    Options,
    RawMotion,
    assemble,
    nameless,
    take,
    take_names,
    take_rate,
    tracked,
    wxyz,
)
from tlr_exp.motion.quaternions import rotate


def read(content: Mapping[str, Any], options: Options) -> list[RawMotion]:
    """Joints in the order of the robot's model files, as GMR writes them.

    Raises:
        MotionFileError: see ``raw``.
    """
    joints = take(content, "dof_pos", None)
    position = take(content, "root_pos", 3, frames=len(joints))
    quats = wxyz(take(content, "root_rot", 4, frames=len(joints)))
    qpos = assemble(position, quats, joints, nameless(joints.shape[1]))
    rate = take_rate(content, "fps", options)
    return [RawMotion(rate, qpos, _bodies(content, qpos))]


def _bodies(content: Mapping[str, Any], qpos: Any) -> Bodies | None:
    if content.get("local_body_pos") is None or content.get("link_body_list") is None:
        return None
    names = take_names(content, "link_body_list")
    local = take(content, "local_body_pos", None, 3, frames=len(qpos))
    if local.shape[1] != len(names):
        raise MotionFileError(
            f"local_body_pos has {local.shape[1]} bodies, link_body_list {len(names)}"
        )
    return tracked(names, qpos[:, None, :3] + rotate(qpos[:, None, 3:7], local))
