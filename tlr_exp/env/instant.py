"""Robots beside their reference at one instant, and what several functions need of both."""

from dataclasses import dataclass
from functools import cached_property

from torch import Tensor

from tlr_exp.env.rotations import (
    into_frame,
    rotation_angle,
    rotation_matrix,
    squared_length,
)
from tlr_exp.motion.reference import ReferenceFrame
from tlr_exp.physics.state import PhysicsState
from tlr_exp.robot.spec import RobotSpec


@dataclass(frozen=True)
class Instant:
    """A state and the reference that it is compared with, of n robots.

    Rewards, observations, errors and ends of episodes look at the same few quantities: each is
    computed when it is first asked for, and once. Nobody writes into the state or the results.
    """

    state: PhysicsState
    reference: ReferenceFrame
    spec: RobotSpec

    @cached_property
    def body_pos_error_w(self) -> Tensor:
        """From each body to its reference, m in the world frame, [n, 27, 3]."""
        return self.reference.body_pos_w - self.state.body_pos_w

    @cached_property
    def squared_distance(self) -> Tensor:
        """Squared distance of each body from its reference, m^2, [n, 27]."""
        return squared_length(self.body_pos_error_w)

    @cached_property
    def rotation_angle(self) -> Tensor:
        """Angle between each body and its reference, rad, [n, 27]."""
        return rotation_angle(self.reference.body_quat_w, self.state.body_quat_w)

    @cached_property
    def base_rotation(self) -> Tensor:
        """Orientation of the pelvis as a rotation matrix, [n, 3, 3]; its columns are the axes."""
        return rotation_matrix(self.state.qpos[:, 3:7])

    @cached_property
    def gravity_b(self) -> Tensor:
        """Direction of gravity in the frame of the pelvis, [n, 3]; upright: (0, 0, -1)."""
        return -self.base_rotation[:, 2]

    @cached_property
    def base_lin_vel_b(self) -> Tensor:
        """Linear velocity of the pelvis in its own frame, m/s, [n, 3]."""
        return into_frame(self.state.qvel[:, None, :3], self.base_rotation).squeeze(1)

    @cached_property
    def reference_pos_b(self) -> Tensor:
        """The reference's bodies seen from the robot's pelvis, m in its frame, [n, 27, 3]."""
        return into_frame(
            self.reference.body_pos_w - self.state.qpos[:, None, :3], self.base_rotation
        )
