"""The state that physics hands to the environment, and the small pieces that engines share."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from tlr_exp.errors import UserError
from tlr_exp.robot.spec import RobotSpec


class PhysicsState(NamedTuple):
    """The robots at one instant: positions, velocities and body poses belong to the same time.

    Batches over environments, float32, world frame, SI units. Bodies and joints are in the order
    of the robot's spec; shapes are those of the G1. ``qpos`` and ``qvel`` follow MuJoCo:
    ``qpos`` is the pelvis position, its quaternion wxyz and the joint angles; ``qvel`` is the
    pelvis linear velocity in the world frame, its angular velocity in the BODY frame and the joint
    velocities. Torques and contact forces are those of the last physics step; both are
    zero right after a reset, where no step has been taken.
    """

    qpos: Tensor  # [num_envs, 30]
    qvel: Tensor  # [num_envs, 29]
    body_pos_w: Tensor  # [num_envs, 27, 3]
    body_quat_w: Tensor  # [num_envs, 27, 4] wxyz
    body_lin_vel_w: Tensor  # [num_envs, 27, 3] of the body's origin
    body_ang_vel_w: Tensor  # [num_envs, 27, 3]
    joint_torque: Tensor  # [num_envs, 23] N m, after the effort limits
    foot_contact_force: Tensor  # [num_envs, 2, 3] N, net force on the left and the right foot

    def at(self, env_ids: Tensor) -> "PhysicsState":
        """The state of the environments ``env_ids`` [n] alone, a copy."""
        return PhysicsState(*(values.index_select(0, env_ids) for values in self))


def body_twist(
    cvel: np.ndarray, body_pos: np.ndarray, root_com: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """World-frame linear and angular velocity of bodies at their own origins.

    MuJoCo's ``cvel`` is a twist about the centre of mass c of the whole kinematic tree, so the
    velocity of a body's origin p is v_p = v_c + w x (p - c).

    Args:
        cvel: [n, bodies, 6], angular (rad/s) before linear (m/s), as in MuJoCo.
        body_pos: [n, bodies, 3], origins of the bodies, m.
        root_com: [n, 3], ``subtree_com`` of the tree's root, m.

    Returns:
        Linear velocity (m/s) and angular velocity (rad/s), each [n, bodies, 3], float32.
    """
    count, bodies, _ = cvel.shape
    # Components first: six passes over contiguous memory. p - c is taken in full precision.
    twist = np.empty((6, count, bodies), np.float32)
    np.copyto(twist, cvel.transpose(2, 0, 1), casting="same_kind")
    arm = np.empty((3, count, bodies), np.float32)
    centre = root_com.T[:, :, None]
    np.subtract(body_pos.transpose(2, 0, 1), centre, out=arm, casting="same_kind")
    linear = np.empty((count, bodies, 3), np.float32)
    angular = np.empty((count, bodies, 3), np.float32)
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        linear[..., i] = twist[3 + i] + twist[j] * arm[k] - twist[k] * arm[j]
        angular[..., i] = twist[i]
    return linear, angular


def is_finite(value: Tensor) -> bool:
    """Whether all elements are finite; on the CPU without torch's threads (see ``native``)."""
    if value.device.type == "cpu":
        return bool(np.isfinite(value.detach().numpy()).all())
    return bool(torch.isfinite(value).all())


def check_joint_target(joint_target: Tensor, num_envs: int, spec: RobotSpec) -> None:
    """Refuse joint targets that no engine could follow.

    Raises:
        ValueError: not of shape [num_envs, num_joints], or not finite. MuJoCo would quietly put
            zeros in the place of a target that is not finite.
    """
    if joint_target.shape != (num_envs, spec.num_joints):
        raise UserError(
            f"joint_target has the shape {list(joint_target.shape)}; "
            f"expected [{num_envs}, {spec.num_joints}]"
        )
    if not is_finite(joint_target):
        bad = torch.nonzero(~torch.isfinite(joint_target).all(dim=1)).flatten()
        raise UserError(
            f"joint_target is not finite in {len(bad)} of {num_envs} environments: "
            f"{bad[:8].tolist()}"
        )


def check_reset(
    env_ids: Tensor, qpos: Tensor, qvel: Tensor, num_envs: int, spec: RobotSpec
) -> None:
    """Refuse a reset that names an environment twice or that starts from an invalid state.

    Args:
        env_ids: [n] int64; any order, each at most once.
        qpos, qvel: [n, num_qpos] and [n, num_qvel].

    Raises:
        ValueError: wrong shape, unknown or repeated environment, or a state that is not finite.
    """
    count = env_ids.numel()
    if env_ids.ndim != 1 or env_ids.is_floating_point() or env_ids.dtype == torch.bool:
        raise UserError(
            f"env_ids must be a vector of integers, not {env_ids.dtype} {list(env_ids.shape)}"
        )
    for name, value, width in (("qpos", qpos, spec.num_qpos), ("qvel", qvel, spec.num_qvel)):
        if value.shape != (count, width):
            raise UserError(
                f"{name} has the shape {list(value.shape)}; expected [{count}, {width}] "
                "for the environments to reset"
            )
        if not is_finite(value):
            raise UserError(f"{name} holds values that are not finite; a reset needs finite ones")
    ids = env_ids.tolist()
    if count and not 0 <= min(ids) <= max(ids) < num_envs:
        raise UserError(f"env_ids must lie in 0..{num_envs - 1}, got {min(ids)}..{max(ids)}")
    if len(set(ids)) < count:
        raise UserError("env_ids names an environment more than once")


def check_saved_state(saved: Mapping[str, Tensor], shapes: Mapping[str, Sequence[int]]) -> None:
    """Refuse a saved physics state that this engine cannot continue from.

    Args:
        saved: a ``state_dict``.
        shapes: what this engine's own ``state_dict`` holds; every shape begins with num_envs.

    Raises:
        ValueError: saved by another engine, for another number of environments or another robot.
    """
    if set(saved) != set(shapes):
        raise UserError(
            f"the saved physics state holds {', '.join(sorted(saved))}, this engine needs "
            f"{', '.join(sorted(shapes))}: it was saved by another engine"
        )
    for name, shape in shapes.items():
        found = tuple(saved[name].shape)
        if found[0] != shape[0]:
            raise UserError(
                f"the saved physics state has {found[0]} environments, this one has {shape[0]}; "
                f"resume with num_envs={found[0]}"
            )
        if found != tuple(shape):
            raise UserError(
                f"the saved {name} has the shape {list(found)}, this model's has {list(shape)}: "
                "it was saved with another robot"
            )
