"""One control step of all environments: what reward terms are functions of."""

from dataclasses import dataclass

import torch
from torch import Tensor

from tlr_exp.env.instant import Instant
from tlr_exp.motion.reference import ReferenceFrame
from tlr_exp.physics.state import PhysicsState
from tlr_exp.robot.model import Robot
from tlr_exp.robot.spec import RobotSpec


@dataclass(frozen=True)
class JointLimits:
    """What the motors and joints allow: range [23, 2] rad, velocity [23] rad/s, effort [23] N m."""

    range_rad: Tensor
    velocity_rad_s: Tensor
    effort_nm: Tensor

    @classmethod
    def of(cls, robot: Robot, device: torch.device) -> "JointLimits":
        """Those of a robot."""
        tables = (robot.joint_range_rad, robot.velocity_limit_rad_s, robot.effort_limit_nm)
        return cls(*(torch.as_tensor(each, dtype=torch.float32, device=device) for each in tables))


@dataclass(frozen=True)
class Transition:
    """One control step of all environments, seen from the instant after it.

    The reference is the one that the step was to reach; actions are raw, [num_envs, 23];
    ``terminated`` [num_envs] is true where the step ended the episode by a failure.
    """

    instant: Instant
    action: Tensor
    previous_action: Tensor
    terminated: Tensor
    limits: JointLimits

    @property
    def state(self) -> PhysicsState:
        return self.instant.state

    @property
    def reference(self) -> ReferenceFrame:
        return self.instant.reference

    @property
    def spec(self) -> RobotSpec:
        return self.instant.spec
