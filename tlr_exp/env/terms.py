"""Reward terms: each a pure function of one transition that returns its raw, unweighted value.

Tracking terms lie in [0, 1] and are 1 at perfect tracking; all others are costs, at least 0, that
enter the reward with a negative coefficient. Every term maps a ``Transition`` of
``num_envs`` environments to a float32 tensor [num_envs]. A coefficient or a weight has no place
here: see ``tlr_exp.reward.split``.
"""

from collections.abc import Callable
from dataclasses import dataclass

import torch
from torch import Tensor

from tlr_exp import keys
from tlr_exp.env.instant import Instant
from tlr_exp.env.rotations import rotation_angle
from tlr_exp.motion.reference import ReferenceFrame
from tlr_exp.physics.state import PhysicsState
from tlr_exp.robot.spec import RobotSpec


@dataclass(frozen=True)
class JointLimits:
    """What the motors and joints allow: range [23, 2] rad, velocity [23] rad/s, effort [23] N m."""

    range_rad: Tensor
    velocity_rad_s: Tensor
    effort_nm: Tensor


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


# --- upper layer: tracking -------------------------------------------------------------------


def _position_error(step: Transition, bodies: tuple[int, ...] | slice) -> Tensor:
    """Squared position error averaged over axes and bodies, m^2, [num_envs]."""
    return step.instant.squared_distance[:, bodies].mean(dim=-1) / 3.0


def _mean_square(vectors: Tensor) -> Tensor:
    """Mean over bodies of the squared length of ``vectors`` [num_envs, n, 3], [num_envs]."""
    # In one sum: sums over three numbers each take several times as long.
    return vectors.flatten(1).square().sum(dim=-1) / vectors.shape[1]


def body_pos(step: Transition, sigma: float) -> Tensor:
    """exp(-(1/sigma) (1/3N) sum ||p_ref - p||^2), section 3.2 of the paper; sigma in m^2."""
    return torch.exp(-_position_error(step, slice(None)) / sigma)


def body_rot(step: Transition, sigma: float) -> Tensor:
    """exp(-(1/N) sum theta^2 / sigma), section 3.2 of the paper; sigma in rad^2."""
    angle = rotation_angle(step.reference.body_quat_w, step.state.body_quat_w)
    return torch.exp(-angle.square().mean(dim=-1) / sigma)


def body_vel(step: Transition, sigma: float) -> Tensor:
    """exp(-(1/N) sum ||dv||^2 / sigma), section 3.2 of the paper; sigma in (m/s)^2."""
    error = step.reference.body_lin_vel_w - step.state.body_lin_vel_w
    return torch.exp(-_mean_square(error) / sigma)


def body_ang_vel(step: Transition, sigma: float) -> Tensor:
    """exp(-(1/N) sum ||domega||^2 / sigma), section 3.2 of the paper; sigma in (rad/s)^2."""
    error = step.reference.body_ang_vel_w - step.state.body_ang_vel_w
    return torch.exp(-_mean_square(error) / sigma)


def upper_body_pos(step: Transition, sigma: float) -> Tensor:
    """As ``body_pos`` over arms, hands and head (ASAP)."""
    return torch.exp(-_position_error(step, step.spec.upper_body) / sigma)


def lower_body_pos(step: Transition, sigma: float) -> Tensor:
    """As ``body_pos`` over pelvis, legs and torso (ASAP)."""
    return torch.exp(-_position_error(step, step.spec.lower_body) / sigma)


def three_point_pos(step: Transition, sigma: float) -> Tensor:
    """As ``body_pos`` over the hands and the head (ASAP)."""
    return torch.exp(-_position_error(step, step.spec.three_points) / sigma)


def feet_pos(step: Transition, sigma: float) -> Tensor:
    """As ``body_pos`` over the two ankle-roll links (ASAP)."""
    return torch.exp(-_position_error(step, step.spec.feet) / sigma)


def joint_pos(step: Transition, sigma: float) -> Tensor:
    """exp(-(1/N) sum (q_ref - q)^2 / sigma) over the joints (ASAP); sigma in rad^2."""
    error = step.reference.qpos[:, 7:] - step.state.qpos[:, 7:]
    return torch.exp(-error.square().mean(dim=-1) / sigma)


def joint_vel(step: Transition, sigma: float) -> Tensor:
    """exp(-(1/N) sum (dq_ref - dq)^2 / sigma) over the joints (ASAP); sigma in (rad/s)^2."""
    error = step.reference.qvel[:, 6:] - step.state.qvel[:, 6:]
    return torch.exp(-error.square().mean(dim=-1) / sigma)


# --- lower layer: penalties and regularisers -------------------------------------------------


def base_height(step: Transition) -> Tensor:
    """(h_base - h_des)^2 in m^2, Table 1; h_des is the pelvis height of the reference."""
    return (step.state.qpos[:, 2] - step.reference.qpos[:, 2]).square()


def ang_vel_xy(step: Transition) -> Tensor:
    """||omega_base,xy||^2 in (rad/s)^2, Table 1: roll and pitch rate in the base frame."""
    return step.state.qvel[:, 3:5].square().sum(dim=-1)


def lin_vel_z(step: Transition) -> Tensor:
    """v_base,z^2 in (m/s)^2, Table 1: vertical velocity in the base frame."""
    return step.instant.base_lin_vel_b[:, 2].square()


def dof_pos_limits(step: Transition, margin: float) -> Tensor:
    """Squared intrusion into the margin inside both joint limits, mean over joints, rad^2.

    Table 1, read so that the margin lies inside the limit: it begins ``margin`` times half the
    range before each end (q_nominal is the midpoint).
    """
    low, high = step.limits.range_rad.unbind(-1)
    inset = margin * 0.5 * (high - low)
    position = step.state.qpos[:, 7:]
    over = (position - (high - inset)).clamp(min=0.0)
    under = ((low + inset) - position).clamp(min=0.0)
    return (over.square() + under.square()).mean(dim=-1)


def dof_vel_limits(step: Transition, margin: float) -> Tensor:
    """(1/N) sum max(0, |dq| - (1 - margin) dq_max)^2 in (rad/s)^2, Table 1."""
    limit = (1.0 - margin) * step.limits.velocity_rad_s
    return (step.state.qvel[:, 6:].abs() - limit).clamp(min=0.0).square().mean(dim=-1)


def torque_limits(step: Transition, margin: float) -> Tensor:
    """(1/N) sum max(0, |tau| - (1 - margin) tau_max)^2 in (N m)^2, Table 1."""
    limit = (1.0 - margin) * step.limits.effort_nm
    return (step.state.joint_torque.abs() - limit).clamp(min=0.0).square().mean(dim=-1)


def action_smoothness(step: Transition) -> Tensor:
    """Sum over joints of the squared change of the raw action (Figure 14; ASAP's action rate)."""
    return (step.action - step.previous_action).square().sum(dim=-1)


def torques(step: Transition) -> Tensor:
    """Sum over joints of the squared torque, (N m)^2 (ASAP)."""
    return step.state.joint_torque.square().sum(dim=-1)


def termination(step: Transition) -> Tensor:
    """1 where the step ended the episode by a failure, 0 elsewhere (ASAP)."""
    return step.terminated.to(step.state.qpos.dtype)


TERMS: dict[str, Callable[..., Tensor]] = {
    keys.BODY_POS: body_pos,
    keys.BODY_ROT: body_rot,
    keys.BODY_VEL: body_vel,
    keys.BODY_ANG_VEL: body_ang_vel,
    keys.UPPER_BODY_POS: upper_body_pos,
    keys.LOWER_BODY_POS: lower_body_pos,
    keys.THREE_POINT_POS: three_point_pos,
    keys.FEET_POS: feet_pos,
    keys.JOINT_POS: joint_pos,
    keys.JOINT_VEL: joint_vel,
    keys.BASE_HEIGHT: base_height,
    keys.ANG_VEL_XY: ang_vel_xy,
    keys.LIN_VEL_Z: lin_vel_z,
    keys.DOF_POS_LIMITS: dof_pos_limits,
    keys.DOF_VEL_LIMITS: dof_vel_limits,
    keys.ACTION_SMOOTHNESS: action_smoothness,
    keys.TORQUE_LIMITS: torque_limits,
    keys.TORQUES: torques,
    keys.TERMINATION: termination,
}
