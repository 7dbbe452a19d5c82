"""One suite for every engine: each must agree with a plain loop over ``mj_step``.

The starts are well conditioned: a standing robot that moves its arms, and one in free flight.
Robots that collide with themselves are left out, because MJX has other collision functions for
boxes than the C engine, and so other contact points.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from importlib.util import find_spec

import mujoco
import numpy as np
import pytest
import torch
from torch import Tensor

from tlr_exp.physics.native import NativePhysics
from tlr_exp.physics.protocol import Physics
from tlr_exp.robot.model import Robot

NUM_ENVS = 8
CHECKED_STEPS = (1, 10, 50)
FIELDS = {
    "qpos": "position",
    "body_pos_w": "position",
    "body_quat_w": "position",
    "qvel": "velocity",
    "body_lin_vel_w": "velocity",
    "body_ang_vel_w": "velocity",
    "joint_torque": "torque",
    "foot_contact_force": "force",
}
# Largest deviations allowed after 1, 10 and 50 control steps: m or rad, m/s or rad/s, N m, N.
# Float32 against float64, and a solver that stops after five iterations, wherever it then is.
SINGLE_PRECISION = {
    "position": (1e-5, 2e-5, 2e-4),
    "velocity": (2e-4, 5e-4, 2e-3),
    "torque": (2e-3, 5e-3, 1e-2),
    "force": (5e-2, 1e-1, 1e-1),
}
# The same engine: all that differs is the rounding of what is returned to float32.
ROUNDING = {"position": (1e-6,) * 3, "velocity": (2e-6,) * 3, "torque": (1e-5,) * 3}
ROUNDING["force"] = (1e-4,) * 3


@dataclass
class PlainLoop:
    """The reference: one MjData a robot, ``mj_step`` in a Python loop."""

    robot: Robot
    data: list[mujoco.MjData] = field(default_factory=list)

    def start(self, qpos: Tensor, qvel: Tensor) -> None:
        self.data = [mujoco.MjData(self.robot.model) for _ in qpos]
        for data, position, velocity in zip(self.data, qpos, qvel, strict=True):
            data.qpos, data.qvel = position.numpy(), velocity.numpy()

    def step(self, joint_target: Tensor) -> dict[str, np.ndarray]:
        states = []
        for data, target in zip(self.data, joint_target, strict=True):
            data.ctrl = target.numpy()
            mujoco.mj_step(self.robot.model, data, nstep=4)
            states.append(self._describe(data))
        return {name: np.stack([state[name] for state in states]) for name in FIELDS}

    def _describe(self, data: mujoco.MjData) -> dict[str, np.ndarray]:
        model, bodies = self.robot.model, self.robot.body_ids
        now = mujoco.MjData(model)  # the pose at the new instant, computed apart
        now.qpos, now.qvel = data.qpos, data.qvel
        mujoco.mj_fwdPosition(model, now)
        mujoco.mj_fwdVelocity(model, now)
        twists = np.zeros((len(bodies), 6))
        for row, body in enumerate(bodies):
            mujoco.mj_objectVelocity(model, now, mujoco.mjtObj.mjOBJ_XBODY, body, twists[row], 0)
        return {
            "qpos": data.qpos.copy(),
            "qvel": data.qvel.copy(),
            "body_pos_w": now.xpos[bodies],
            "body_quat_w": now.xquat[bodies],
            "body_lin_vel_w": twists[:, 3:],
            "body_ang_vel_w": twists[:, :3],
            "joint_torque": data.actuator_force.copy(),
            "foot_contact_force": self._foot_forces(data),
        }

    def _foot_forces(self, data: mujoco.MjData) -> np.ndarray:
        """The contact forces of the last substep, summed contact by contact."""
        model, total = self.robot.model, np.zeros((2, 3))
        for index, contact in enumerate(data.contact):
            wrench = np.zeros(6)
            mujoco.mj_contactForce(model, data, index, wrench)
            force = contact.frame.reshape(3, 3).T @ wrench[:3]
            for foot, body in enumerate(self.robot.foot_body_ids):
                total[foot] += force * (model.geom_bodyid[contact.geom2] == body)
                total[foot] -= force * (model.geom_bodyid[contact.geom1] == body)
        return total


Case = tuple[Tensor, Tensor, Tensor]  # qpos, qvel, joint targets [steps, num_envs, 23]


@pytest.fixture(scope="module")
def standing(robot: Robot) -> Case:
    """Both feet on the floor, at rest; the arms move, each robot's in its own way."""
    default = torch.from_numpy(robot.default_joint_pos_rad)
    qpos = torch.cat([torch.tensor([0.0, 0.0, 0.757, 1.0, 0.0, 0.0, 0.0]), default]).expand(8, -1)
    pose = default.clone()
    pose[[4, 10]] += 0.1  # on soft ankles the default pose tips forward within a second
    settle = PlainLoop(robot)
    settle.start(qpos, torch.zeros(NUM_ENVS, 29))
    for _ in range(10):
        rest = settle.step(pose.expand(NUM_ENVS, -1))
    generator = torch.Generator().manual_seed(0)
    joint_targets = pose.repeat(50, NUM_ENVS, 1)
    reach = 0.3 * torch.rand(NUM_ENVS, 8, generator=generator)
    joint_targets[..., 15:] += torch.sin(torch.arange(50) / 8)[:, None, None] * reach
    return (
        torch.from_numpy(rest["qpos"]).float(),
        torch.from_numpy(rest["qvel"]).float(),
        joint_targets.float(),
    )


@pytest.fixture(scope="module")
def flight(robot: Robot) -> Case:
    """High in the air, turning, with every joint moving: no contact within the second."""
    generator = torch.Generator().manual_seed(1)
    default = torch.from_numpy(robot.default_joint_pos_rad).float()
    quat = torch.randn(NUM_ENVS, 4, generator=generator)
    quat = quat / quat.norm(dim=1, keepdim=True)
    root = torch.tensor([0.0, 0.0, 8.0]).expand(NUM_ENVS, -1)
    qpos = torch.cat([root, quat, default.expand(NUM_ENVS, -1)], dim=1)
    qvel = 0.5 * torch.randn(NUM_ENVS, 29, generator=generator)
    noise = 0.05 * torch.randn(50, NUM_ENVS, 23, generator=generator)
    return qpos, qvel, default + noise


@pytest.fixture(scope="module", params=["standing", "flight"])
def case(request: pytest.FixtureRequest) -> Case:
    return request.getfixturevalue(request.param)


@pytest.fixture(scope="module")
def reference(robot: Robot, case: Case) -> dict[int, dict[str, np.ndarray]]:
    """The plain loop's states after 1, 10 and 50 control steps."""
    qpos, qvel, joint_targets = case
    loop = PlainLoop(robot)
    loop.start(qpos, qvel)
    states = [loop.step(target) for target in joint_targets]
    return {count: states[count - 1] for count in CHECKED_STEPS}


def _assert_parity(
    physics: Physics,
    case: Case,
    reference: dict[int, dict[str, np.ndarray]],
    tolerances: dict[str, tuple[float, ...]],
) -> None:
    qpos, qvel, joint_targets = (value.to(physics.device) for value in case)
    physics.set_state(torch.arange(NUM_ENVS), qpos, qvel)
    for count, target in enumerate(joint_targets, start=1):
        state = physics.step(target)
        if count not in CHECKED_STEPS:
            continue
        for name, kind in FIELDS.items():
            found = getattr(state, name).cpu().double().numpy()
            worst = np.abs(found - reference[count][name]).max()
            allowed = tolerances[kind][CHECKED_STEPS.index(count)]
            assert worst <= allowed, f"{name} is {worst:.2e} off after {count} control steps"


def test_native(robot: Robot, case: Case, reference: dict[int, dict[str, np.ndarray]]) -> None:
    _assert_parity(NativePhysics(robot, NUM_ENVS, num_threads=2), case, reference, ROUNDING)


def test_mjx(
    make_mjx: Callable[..., Physics], case: Case, reference: dict[int, dict[str, np.ndarray]]
) -> None:
    _assert_parity(make_mjx("jax", "cpu"), case, reference, SINGLE_PRECISION)


@pytest.mark.slow
@pytest.mark.skipif(find_spec("warp") is None, reason="warp-lang is not installed")
def test_mjx_warp(
    make_mjx: Callable[..., Physics], case: Case, reference: dict[int, dict[str, np.ndarray]]
) -> None:
    _assert_parity(make_mjx("warp", "cpu"), case, reference, SINGLE_PRECISION)


@pytest.mark.gpu
@pytest.mark.skipif(not torch.cuda.is_available(), reason="no CUDA device")
@pytest.mark.parametrize("impl", ["jax", "warp"])
def test_mjx_on_a_gpu(
    make_mjx: Callable[..., Physics],
    case: Case,
    reference: dict[int, dict[str, np.ndarray]],
    impl: str,
) -> None:
    if impl == "warp" and find_spec("warp") is None:
        pytest.skip("warp-lang is not installed")
    _assert_parity(make_mjx(impl, "cuda"), case, reference, SINGLE_PRECISION)


def test_the_cases_are_what_they_claim(robot: Robot, standing: Case, flight: Case) -> None:
    """Standing robots bear their weight on both feet throughout; flying ones touch nothing."""
    weight = robot.model.body_mass.sum() * 9.81
    for (qpos, qvel, joint_targets), on_the_floor in ((standing, True), (flight, False)):
        loop = PlainLoop(robot)
        loop.start(qpos, qvel)
        carried = []
        for target in joint_targets:
            carried.append(loop.step(target)["foot_contact_force"][..., 2] / weight)
            assert on_the_floor or not any(data.ncon for data in loop.data)
        if on_the_floor:
            assert np.min(carried) > 0.2
            np.testing.assert_allclose(np.sum(carried, axis=2).mean(axis=0), 1.0, atol=0.1)
        else:
            assert np.max(carried) == 0
