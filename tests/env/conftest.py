"""Synthetic transitions: robots exactly on their reference, and robots unrelated to it."""

from collections.abc import Callable
from dataclasses import replace

import pytest
import torch
from torch import Tensor

from tlr_exp.env.instant import Instant
from tlr_exp.env.transition import JointLimits, Transition
from tlr_exp.motion.reference import ReferenceFrame
from tlr_exp.physics.state import PhysicsState
from tlr_exp.robot.g1 import G1

BODIES = len(G1.tracked_bodies)
JOINTS = G1.num_joints


@pytest.fixture(scope="session")
def random_frame() -> Callable[..., ReferenceFrame]:
    """``random_frame(num_envs, seed=0)``: unrelated random values; quaternions are unit ones."""

    def make(num_envs: int, seed: int = 0) -> ReferenceFrame:
        generator = torch.Generator().manual_seed(seed)

        def draw(*shape: int) -> Tensor:
            return torch.randn(num_envs, *shape, generator=generator)

        qpos = draw(30)
        qpos[:, 3:7] = torch.nn.functional.normalize(qpos[:, 3:7], dim=-1)
        return ReferenceFrame(
            qpos=qpos,
            qvel=draw(29),
            body_pos_w=draw(BODIES, 3),
            body_quat_w=torch.nn.functional.normalize(draw(BODIES, 4), dim=-1),
            body_lin_vel_w=draw(BODIES, 3),
            body_ang_vel_w=draw(BODIES, 3),
        )

    return make


@pytest.fixture(scope="session")
def state_on() -> Callable[[ReferenceFrame], PhysicsState]:
    """``state_on(frame)``: a robot equal to ``frame``, without torque and contact."""

    def make(frame: ReferenceFrame) -> PhysicsState:
        num_envs = len(frame.qpos)
        return PhysicsState(
            **{name: value.clone() for name, value in frame._asdict().items()},
            joint_torque=torch.zeros(num_envs, JOINTS),
            foot_contact_force=torch.zeros(num_envs, 2, 3),
        )

    return make


@pytest.fixture(scope="session")
def tracking(random_frame, state_on) -> Callable[..., Transition]:
    """``tracking(num_envs=1, seed=0, **fields)``: perfect tracking without torque and action.

    Every joint has the range [-1, 3] rad, 10 rad/s and 50 N m. ``fields`` are other values for
    fields of the transition or of its state: ``tracking(foot_contact_force=...)``.
    """

    def make(num_envs: int = 1, seed: int = 0, **fields: Tensor) -> Transition:
        frame = random_frame(num_envs, seed)
        of_state = {name: fields.pop(name) for name in PhysicsState._fields if name in fields}
        limits = JointLimits(
            torch.tensor([[-1.0, 3.0]]).expand(JOINTS, 2),
            torch.full((JOINTS,), 10.0),
            torch.full((JOINTS,), 50.0),
        )
        step = Transition(
            instant=Instant(state_on(frame)._replace(**of_state), frame, G1),
            action=torch.zeros(num_envs, JOINTS),
            previous_action=torch.zeros(num_envs, JOINTS),
            terminated=torch.zeros(num_envs, dtype=torch.bool),
            limits=limits,
        )
        return replace(step, **fields)  # type: ignore[arg-type]

    return make


@pytest.fixture(scope="session")
def unrelated(tracking, random_frame, state_on) -> Callable[..., Transition]:
    """``unrelated(num_envs, seed=0)``: robots that have nothing to do with their reference."""

    def make(num_envs: int, seed: int = 0) -> Transition:
        generator = torch.Generator().manual_seed(seed)
        state = state_on(random_frame(num_envs, seed + 1))
        state.joint_torque.copy_(60.0 * torch.randn(num_envs, JOINTS, generator=generator))
        state.qpos[:, 7:] *= 3.0
        state.qvel[:, 6:] *= 10.0
        action, previous_action = torch.randn(2, num_envs, JOINTS, generator=generator)
        terminated = torch.rand(num_envs, generator=generator) < 0.5
        state.foot_contact_force.copy_(torch.randn(num_envs, 2, 3, generator=generator))
        return tracking(
            num_envs,
            seed,
            action=action,
            previous_action=previous_action,
            terminated=terminated,
            **state._asdict(),
        )

    return make
