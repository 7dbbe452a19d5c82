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
        farthest, fastest = state.qpos.abs(), state.qvel.abs()
        # One maximum over all robots takes a fifth of the time of one for each robot, and nearly
        # always says that all is well.
        if _are_stable(farthest.max(), fastest.max()):
            return state, torch.zeros(len(action), dtype=torch.bool, device=action.device)
        unstable = ~_are_stable(farthest.amax(-1), fastest.amax(-1))
        # Selecting by a mask copies.
        self._rows.append((before.qpos[unstable], before.qvel[unstable], action[unstable]))
        replaced = (
            torch.where(unstable.reshape(-1, *[1] * (new.ndim - 1)), old, new)
            for old, new in zip(before, state, strict=True)
        )
        return PhysicsState(*replaced), unstable

    def take(self) -> dict[str, Tensor]:
        """What was remembered since the last call: qpos, qvel and action [n, ...]."""
        rows, self._rows = self._rows, []
        names = ("qpos", "qvel", "action")
        columns = zip(*rows, strict=True) if rows else [[torch.empty(0)]] * len(names)
        return {n: torch.cat(list(column)) for n, column in zip(names, columns, strict=True)}


def _are_stable(farthest: Tensor, fastest: Tensor) -> Tensor:
    """Whether simulations with such largest positions and speeds go on."""
    # The maximum of numbers with a NaN among them is NaN, and no comparison with NaN is true.
    return (farthest < torch.inf) & (fastest < MAX_SPEED)
