"""Where episodes start: noise on the state that is copied from the reference."""

import torch
from torch import Tensor

from tlr_exp.config.settings import ResetNoise
from tlr_exp.env.rotations import from_rotation_vector, multiply


def perturb(
    qpos: Tensor,
    qvel: Tensor,
    noise: ResetNoise,
    joint_range_rad: Tensor,
    generator: torch.Generator,
) -> tuple[Tensor, Tensor]:
    """Add ``noise`` to states ``qpos`` [n, 30] and ``qvel`` [n, 29]; joints stay in their range."""
    if not any(vars(noise).values()):
        return qpos, qvel

    def uniform(width: int, half_width: float) -> Tensor:
        draw = torch.rand(len(qpos), width, generator=generator, device=qpos.device)
        return (2.0 * draw - 1.0) * half_width

    position = qpos[:, :3] + uniform(3, noise.root_pos_m)
    rotation = multiply(from_rotation_vector(uniform(3, noise.root_rot_rad)), qpos[:, 3:7])
    joints = qpos[:, 7:] + uniform(qpos.shape[1] - 7, noise.joint_pos_rad)
    joints = joints.clamp(joint_range_rad[:, 0], joint_range_rad[:, 1])
    velocity = qvel + torch.cat(
        (
            uniform(3, noise.root_lin_vel),
            uniform(3, noise.root_ang_vel),
            uniform(qvel.shape[1] - 6, noise.joint_vel),
        ),
        dim=-1,
    )
    return torch.cat((position, rotation, joints), dim=-1), velocity
