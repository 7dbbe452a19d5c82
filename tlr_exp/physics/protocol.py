"""The protocol of every physics engine towards the environment."""

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
