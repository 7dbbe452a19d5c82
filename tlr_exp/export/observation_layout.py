"""The order of the numbers in an observation, in words that a program can read."""

from tlr_exp.env.observations import (
    ANG_VEL_SCALE,
    HISTORY_LENGTH,
    JOINT_VEL_SCALE,
    LIN_VEL_SCALE,
)
from tlr_exp.errors import UserError
from tlr_exp.robot.spec import RobotSpec


def observation_layout(observation: str, spec: RobotSpec) -> list[dict[str, object]]:
    """The parts of an observation in order: name, width, scale, and from how many frames.

    ``of_reference`` parts are of the reference at ``frame``. "base" is the frame of the pelvis.
    A part that repeats does so for frames that go back in time, the present one first, together
    with the others that repeat; at the start all are the first.

    Raises:
        ValueError: there is no observation of that name.
    """
    joints = [
        _part("joint_pos minus default_joint_pos", spec.num_joints),
        _part("joint_vel", spec.num_joints, JOINT_VEL_SCALE),
    ]
    turning = _part("root_ang_vel, base", 3, ANG_VEL_SCALE)
    last = _part("last raw action", spec.num_joints)
    if observation == "history":
        frame = [*joints, turning, _part("direction of gravity, base", 3), last]
        phase = _part("phase", 1)
        return [*({**part, "frames": HISTORY_LENGTH} for part in frame), phase]
    if observation == "reference":
        moving = _part("root_lin_vel, base", 3, LIN_VEL_SCALE)
        width = 3 * spec.num_bodies
        bodies = [
            _part("body positions minus the robot's pelvis, base", width, of_reference=True),
            _part("body linear velocities, base", width, of_reference=True),
        ]
        root = [_part("root_pos, world", 3), _part("root_quat wxyz, world", 4)]
        return [*root, moving, turning, *joints, last, *bodies]
    raise UserError(f"there is no observation {observation!r}")


def _part(
    name: str, width: int, scale: float = 1.0, of_reference: bool = False
) -> dict[str, object]:
    return {
        "name": name,
        "width": width,
        "scale": scale,
        "frames": 1,
        "of_reference": of_reference,
    }
