"""From raw actions to joint targets: what an action is relative to, and how far it reaches."""

from functools import partial

import torch
from torch import Tensor

from tlr_exp.motion.reference import ReferenceFrame
from tlr_exp.robot.model import Robot


class JointTargets:
    """Turns actions into the targets of the joints' PD control, ``zero + scale * action``.

    Args:
        choice: what the target of a zero action is (the key ``env.action``).
        robot: its default pose, gains and action scales.
        device: of the tensors.

    Attributes:
        default_pos: pose that the robot is built in, rad, [23].
        scale: rad per unit of action, [23].
    """

    def __init__(self, choice: str, robot: Robot, device: torch.device) -> None:
        tensor = partial(torch.as_tensor, dtype=torch.float32, device=device)
        self.choice = choice
        self.default_pos = tensor(robot.default_joint_pos_rad)
        self.scale = tensor(robot.action_scale_rad)
        self._damping_time_s = tensor(robot.kd / robot.kp)

    def __call__(self, action: Tensor, joint_pos: Tensor, coming: ReferenceFrame) -> Tensor:
        """Joint targets in rad, [num_envs, 23].

        Args:
            action: raw, [num_envs, 23].
            joint_pos: where the joints are, rad, [num_envs, 23].
            coming: the reference that this step is to reach, with which its end is compared.
        """
        return self._of_zero_action(joint_pos, coming) + self.scale * action

    def _of_zero_action(self, joint_pos: Tensor, coming: ReferenceFrame) -> Tensor:
        match self.choice:
            case "current_pose":
                return joint_pos
            case "reference_pose":
                return coming.qpos[:, 7:]
            case "reference_motion":
                # With a target that is ahead by velocity * kd / kp, the PD control damps only what
                # differs from the reference's velocity.
                return coming.qpos[:, 7:] + self._damping_time_s * coming.qvel[:, 6:]
            case _:
                return self.default_pos
