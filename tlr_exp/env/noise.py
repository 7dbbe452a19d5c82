"""What the sensors say of a robot: its state with noise, of which the actor is shown a part.

Noise is added to the state, in SI units, before anything is scaled or normalised. So all that the
actor sees of a quantity errs together: with the tilt of the pelvis also where the reference seems
to be.
"""

import torch
from torch import Tensor

from tlr_exp.config.settings import ObservationNoise
from tlr_exp.env.instant import Instant
from tlr_exp.env.rotations import from_rotation_vector, multiply, rotate
from tlr_exp.robot.spec import RobotSpec


class NoisySensors:
    """Adds noise to instants; the same instant where there is none.

    Args:
        noise: how much of which (the group ``env.noise``).
        spec: the robot, for its number of joints.
        seed: of the generator that all noise is drawn from.
        device: where the states are.
    """

    def __init__(
        self, noise: ObservationNoise, spec: RobotSpec, seed: int, device: torch.device
    ) -> None:
        joints = spec.num_joints
        scales = [
            *[noise.root_pos] * 3,
            *[noise.gravity] * 2,  # about the horizontal axes of the world
            noise.heading,  # about the vertical one
            *[noise.root_lin_vel] * 3,
            *[noise.gyro] * 3,
            *[noise.joint_pos] * joints,
            *[noise.joint_vel] * joints,
        ]
        self._widths = (3, 3, 3, 3, joints, joints)
        self._scales = torch.tensor(scales, device=device)
        self._is_gaussian = noise.distribution == "gaussian"
        self._is_off = not any(scales)
        self.generator = torch.Generator(device=device).manual_seed(seed)

    def __call__(self, instant: Instant) -> Instant:
        """The instant of n robots as their sensors have it; only what the actor sees is changed."""
        if self._is_off:
            return instant
        state = instant.state
        errors = self._draw(len(state.qpos)).split(self._widths, dim=-1)
        position, rotation, lin_vel, gyro, joint_pos, joint_vel = errors
        # About the axes of the world: gravity then errs by the same angle in any pose.
        quat = multiply(from_rotation_vector(rotation), state.qpos[:, 3:7])
        qpos = torch.cat((state.qpos[:, :3] + position, quat, state.qpos[:, 7:] + joint_pos), -1)
        # The linear velocity is that of an estimator in the frame of the pelvis, as the gyro is.
        change = torch.cat((rotate(quat, lin_vel), gyro, joint_vel), dim=-1)
        noisy = state._replace(qpos=qpos, qvel=state.qvel + change)
        return Instant(noisy, instant.reference, instant.spec)

    def _draw(self, count: int) -> Tensor:
        size, device = (count, len(self._scales)), self._scales.device
        if self._is_gaussian:
            return self._scales * torch.randn(size, generator=self.generator, device=device)
        draws = torch.rand(size, generator=self.generator, device=device)
        return self._scales * (2.0 * draws - 1.0)
