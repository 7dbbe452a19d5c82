"""Starting states, targets and compiled engines that the tests of the engines share."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import torch
from filelock import FileLock
from torch import Tensor

from tlr_exp.physics.state import PhysicsState
from tlr_exp.robot.model import Robot

StartState = tuple[Tensor, Tensor]


@pytest.fixture(scope="session")
def start_states(robot: Robot) -> Callable[[int, int], StartState]:
    """``start_states(n, seed)``: qpos [n, 30] and qvel [n, 29] of robots near the default pose.

    Feet touch the floor in some and are in the air in others; every joint is off its default.
    """

    def make(num_envs: int, seed: int) -> StartState:
        generator = torch.Generator().manual_seed(seed)

        def noise(width: int, scale: float) -> Tensor:
            return scale * torch.randn(num_envs, width, generator=generator)

        default = torch.from_numpy(robot.default_joint_pos_rad).float()
        root = torch.tensor([0.0, 0.0, 0.75]) + noise(3, 0.02)
        quat = torch.tensor([1.0, 0.0, 0.0, 0.0]) + noise(4, 0.05)
        quat = quat / quat.norm(dim=1, keepdim=True)
        qpos = torch.cat([root, quat, default + noise(23, 0.05)], dim=1)
        return qpos, noise(29, 0.3)

    return make


@pytest.fixture(scope="session")
def targets(robot: Robot) -> Callable[[int, int, int], Tensor]:
    """``targets(n, steps, seed)``: [steps, n, 23] joint targets around the default pose."""

    def make(num_envs: int, num_steps: int, seed: int) -> Tensor:
        generator = torch.Generator().manual_seed(seed)
        default = torch.from_numpy(robot.default_joint_pos_rad).float()
        return default + 0.2 * torch.randn(num_steps, num_envs, 23, generator=generator)

    return make


@pytest.fixture(scope="session")
def assert_same_bits() -> Callable[[PhysicsState, PhysicsState], None]:
    """Asserts that two states are equal in every field, bit for bit."""

    def check(left: PhysicsState, right: PhysicsState) -> None:
        for name, value, expected in zip(left._fields, left, right, strict=True):
            assert torch.equal(value, expected), f"{name} differs"

    return check


@pytest.fixture(scope="session")
def make_mjx(robot: Robot, shared_folder: Path) -> Callable[..., Any]:
    """``make_mjx(impl, device)``: MJX with eight environments, compiled once a session.

    By one process at a time: the others find the program in JAX's cache, which locks nothing.
    """
    made: dict[tuple[str, str], Any] = {}

    def make(impl: str = "jax", device: str = "cpu") -> Any:
        if (impl, device) not in made:
            from tlr_exp.physics.mjx import MjxPhysics

            with FileLock(shared_folder / "jax.lock"):
                made[impl, device] = MjxPhysics(robot, 8, impl, 35, 250, device=device)
        return made[impl, device]

    return make
