"""The protocol of every physics engine towards the environment."""

from collections.abc import Mapping
from typing import Protocol

import torch
from torch import Tensor

from tlr_exp.physics.state import PhysicsState


class Physics(Protocol):
    """Many robots that are stepped together.

    An engine never repairs a simulation that went wrong: its ``qpos`` or ``qvel`` stop being
    finite and stay so until ``set_state`` resets it, and no other simulation is affected.
    """

    num_envs: int
    control_dt: float  # s
    device: torch.device  # where states are returned
    disturbances: tuple[str, ...]  # what it can do of ``push_m_s`` and of the names in ``vary``

    def step(self, joint_target: Tensor) -> PhysicsState:
        """Advance one control step, four physics steps of 0.005 s, towards one set of targets.

        Args:
            joint_target: [num_envs, 23] float, rad, for the joints' PD control.

        Returns:
            The state after the last physics step. Its tensors are the caller's to keep; they
            must not be written to.

        Raises:
            ValueError: a target of the wrong shape or one that is not finite.
        """
        ...

    def set_state(self, env_ids: Tensor, qpos: Tensor, qvel: Tensor) -> None:
        """Reset some environments; all others stay as they were, bit for bit.

        Args:
            env_ids: [n] int64, each at most once, in any order.
            qpos: [n, 30], MuJoCo's convention (quaternion wxyz).
            qvel: [n, 29], linear velocity in the world frame, angular in the body frame.

        Raises:
            ValueError: wrong shape, unknown or repeated environment, or a value that is not
                finite.
        """
        ...

    def push(self, env_ids: Tensor, velocity: Tensor) -> None:
        """Change the velocity of some robots at once: the next step begins with it.

        All else stays as it was, and all other robots do. The state shows it after that step.

        Args:
            env_ids: [n] int64, each at most once.
            velocity: [n, 3], added to that of the pelvis, m/s in the world frame.
        """
        ...

    def vary(self, env_ids: Tensor, values: Mapping[str, Tensor]) -> None:
        """Let some robots differ from their model; ``set_state`` must follow before they step.

        Args:
            env_ids: [n] int64, each at most once.
            values: what differs, by name: ``friction`` [n], the sliding coefficient of all
                contacts; ``mass`` [n, bodies], factors of the mass and inertia of every MuJoCo
                body; ``com_m`` [n, 3], by which the torso's centre of mass is moved, m in its
                frame; ``kp``, ``kd`` and ``armature`` [n, 23], factors of each joint's. What is not
                named stays as it is.
        """
        ...

    def state(self) -> PhysicsState:
        """The current instant."""
        ...

    def state_dict(self) -> dict[str, Tensor]:
        """All that is needed to continue bit for bit, as tensors on the CPU."""
        ...

    def load_state_dict(self, state_dict: dict[str, Tensor]) -> None:
        """Continue from a saved state.

        Raises:
            ValueError: the saved state is of another number of environments or another model.
        """
        ...
