"""Simulations that diverge: put back to where they were, and remembered for inspection."""

import torch
from torch import Tensor

from tlr_exp.physics.state import PhysicsState

# rad/s and m/s. The motors reach 37 rad/s; a simulation that diverges passes through huge values,
# whose squares overflow in the reward terms, before it stops being finite.
MAX_SPEED = 1e3


class UnstableStates:
    """The states and actions from which simulations went wrong."""

    def __init__(self) -> None:
        self._rows: list[tuple[Tensor, ...]] = []

    def replace(
        self, state: PhysicsState, before: PhysicsState, action: Tensor
    ) -> tuple[PhysicsState, Tensor]:
        """Replace diverged states by those before the step, and remember these.

        Returns:
            The states, and which of them diverged [num_envs] bool.
        """
        # A comparison with NaN is false.
        unstable = ~(state.qpos.isfinite().all(-1) & (state.qvel.abs() < MAX_SPEED).all(-1))
        if not unstable.any():
            return state, unstable
        # Selecting by a mask copies.
        self._rows.append((before.qpos[unstable], before.qvel[unstable], action[unstable]))
        return before.where(unstable, state), unstable

    def take(self) -> dict[str, Tensor]:
        """What was remembered since the last call: qpos, qvel and action [n, ...]."""
        rows, self._rows = self._rows, []
        names = ("qpos", "qvel", "action")
        columns = zip(*rows, strict=True) if rows else [[torch.empty(0)]] * len(names)
        return {n: torch.cat(list(column)) for n, column in zip(names, columns, strict=True)}
