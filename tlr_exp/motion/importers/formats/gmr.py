"""GMR's ``.pkl`` (also GMT's, TWIST's): root quaternions xyzw, bodies in the pelvis' frame."""

from collections.abc import Mapping
from typing import Any

from tlr_exp.motion.importers.raw import (
    Conventions,
    FileBodies,
    Options,
    Recorded,
    take,
    take_named_bodies,
    take_rate,
)
from tlr_exp.robot.spec import RobotSpec


def read(content: Mapping[str, Any], options: Options, spec: RobotSpec) -> Recorded:
    """Joints in the order of the robot's model files, as GMR writes them.

    Raises:
        MotionFileError: see ``raw``.
    """
    joints = take(content, "dof_pos", None)
    position = take(content, "root_pos", 3, frames=len(joints))
    quats = take(content, "root_rot", 4, frames=len(joints))
    rate = take_rate(content, "fps", options)
    conventions = Conventions(quaternion="xyzw", joint_order="mujoco")
    bodies = _bodies(content, len(joints))
    return Recorded(rate, position, quats, joints, None, conventions, bodies)


def _bodies(content: Mapping[str, Any], frames: int) -> FileBodies | None:
    if content.get("local_body_pos") is None or content.get("link_body_list") is None:
        return None
    return FileBodies(
        *take_named_bodies(content, "local_body_pos", "link_body_list", frames), local=True
    )
