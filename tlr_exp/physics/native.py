"""MuJoCo's C engine, one simulation per environment, on a pool of CPU threads."""

import copy
import warnings
from collections.abc import Iterator, Mapping
from contextlib import contextmanager

import mujoco
import numpy as np
import torch
from mujoco.batch import Batch, SimulationError
from torch import Tensor

from tlr_exp.config.checks import check_at_least
from tlr_exp.machine.cores import available_cores
from tlr_exp.physics.state import (
    PhysicsState,
    body_twist,
    check_joint_target,
    check_reset,
    check_saved_state,
)
from tlr_exp.physics.variations import VARIATIONS, Variations
from tlr_exp.robot.model import Robot
from tlr_exp.robot.spec import SIDES
from tlr_exp.robot.timing import CONTROL_DT_S, DECIMATION

_FORCES = ("joint_torque", "foot_contact_force")  # outputs of a step, no part of MuJoCo's state
_INSTABILITY = ("Nan, Inf or huge value", "Inertia matrix is too close to singular")


class NativePhysics:
    """``Physics`` on ``mujoco.batch``: the same bits at any number of threads.

    Args:
        robot: the robot; its model is copied.
        num_envs: number of simulations.
        num_threads: threads that share the simulations; 0 takes all cores of this process.
        device: where the returned states live.

    Raises:
        SettingError: ``num_envs`` below 1 or ``num_threads`` below 0.
    """

    disturbances = ("push_m_s", *VARIATIONS)

    def __init__(
        self,
        robot: Robot,
        num_envs: int,
        num_threads: int,
        device: torch.device | str = "cpu",
    ) -> None:
        check_at_least("num_envs", num_envs, 1)
        self.check_settings(num_threads)
        self.spec = robot.spec
        self.num_envs = num_envs
        self.control_dt = CONTROL_DT_S
        self.device = torch.device(device)
        model = copy.copy(robot.model)
        # MuJoCo would put a diverged simulation back to its first pose without a word; what went
        # wrong must show instead.
        model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET
        # persistent: the kinematics of the new state, computed for the state that is returned,
        # are the first part of the next step and cost nothing.
        # MuJoCo's own 0 means all cores of the machine, of which a cluster gives a job a few.
        self._batch = Batch(model, num_envs, num_threads or available_cores(), persistent=True)
        self.num_threads = self._batch.nthread
        self._qpos = self._batch.bind("qpos")
        self._qvel = self._batch.bind("qvel")
        self._ctrl = self._batch.bind("ctrl")
        self._actuator_force = self._batch.bind("actuator_force")
        foot_address = model.sensor(f"{robot.spec.foot_names[0]}_contact").adr[0]
        self._sensed_force = self._batch.bind("sensordata")[:, foot_address : foot_address + 6]
        self._bodies = _BodyReader(self._batch, robot)
        self._variations = Variations(self._batch, robot)
        self._unused = self._batch.state[0].copy()  # the whole state of a new simulation
        self._batch.forward(stage=mujoco.mjtStage.mjSTAGE_VEL)
        # The current instant, by the fields of PhysicsState. Handed out without a copy, so that
        # whatever changes it replaces the arrays and writes into none.
        self._now = self._read_motion() | {
            "joint_torque": np.zeros((num_envs, model.nu), np.float32),
            "foot_contact_force": np.zeros((num_envs, len(SIDES), 3), np.float32),
        }

    @staticmethod
    def check_settings(num_threads: int) -> None:
        """Refuse what the constructor refuses, before it makes simulations."""
        check_at_least("num_threads", num_threads, 0)

    def step(self, joint_target: Tensor) -> PhysicsState:
        """Advance one control step; see ``Physics.step``."""
        check_joint_target(joint_target, self.num_envs, self.spec)
        self._ctrl[:] = joint_target.detach().cpu().numpy()
        try:
            with _engine_warnings():
                self._batch.step(nstep=DECIMATION, stage=mujoco.mjtStage.mjSTAGE_VEL)
        except SimulationError as error:
            # The engine refused these and left them where they were; the others went on. To
            # return the old state as if it were the new one would hide it.
            self._qpos[error.ids] = np.nan
            self._qvel[error.ids] = np.nan
            warnings.warn(str(error), RuntimeWarning, stacklevel=2)
        foot_force = self._sensed_force.astype(np.float32).reshape(-1, len(SIDES), 3)
        self._now = self._read_motion() | {
            "joint_torque": self._actuator_force.astype(np.float32),
            "foot_contact_force": foot_force,
        }
        return self.state()

    def set_state(self, env_ids: Tensor, qpos: Tensor, qvel: Tensor) -> None:
        """Reset some environments; see ``Physics.set_state``."""
        check_reset(env_ids, qpos, qvel, self.num_envs, self.spec)
        ids = env_ids.cpu().numpy()
        order = ids.argsort()
        ids = ids[order]
        # Time, warm start and all else that a simulation continues from.
        self._batch.state[ids] = self._unused
        self._qpos[ids] = qpos.cpu().numpy()[order]
        self._qvel[ids] = qvel.cpu().numpy()[order]
        with _engine_warnings():
            self._batch.forward(ids, stage=mujoco.mjtStage.mjSTAGE_VEL)
        # Of the others nothing has changed, and reading everyone takes several times as long.
        fresh = self._read_motion(ids)
        self._now = {name: array.copy() for name, array in self._now.items()}
        for name, array in self._now.items():
            array[ids] = fresh.get(name, 0.0)  # torque and contact force: no step was taken

    def push(self, env_ids: Tensor, velocity: Tensor) -> None:
        """Change the velocity of some robots; see ``Physics.push``."""
        self._qvel[env_ids.cpu().numpy(), :3] += velocity.cpu().numpy()

    def vary(self, env_ids: Tensor, values: Mapping[str, Tensor]) -> None:
        """Let some robots differ from their model; see ``Physics.vary``."""
        ids = env_ids.cpu().numpy()
        order = ids.argsort()
        rows = {name: value.cpu().double().numpy()[order] for name, value in values.items()}
        self._variations.write(ids[order], rows)

    def state(self) -> PhysicsState:
        """The current instant; see ``Physics.state``."""
        return PhysicsState(
            **{k: torch.from_numpy(v).to(self.device) for k, v in self._now.items()}
        )

    def _read_motion(self, ids: np.ndarray | None = None) -> dict[str, np.ndarray]:
        """All of ``PhysicsState`` but the forces, fresh arrays; of everyone, or of ``ids`` [n]."""
        rows = slice(None) if ids is None else ids
        return {
            "qpos": self._qpos[rows].astype(np.float32),
            "qvel": self._qvel[rows].astype(np.float32),
            **self._bodies.read(ids),
        }

    def state_dict(self) -> dict[str, Tensor]:
        """MuJoCo's integration state (float64) and the outputs of the last physics step."""
        return {
            "integration_state": torch.from_numpy(self._batch.state.copy()),
            **{name: torch.from_numpy(self._now[name].copy()) for name in _FORCES},
        }

    def load_state_dict(self, state_dict: dict[str, Tensor]) -> None:
        """Continue from ``state_dict``; see ``Physics.load_state_dict``."""
        check_saved_state(state_dict, {k: v.shape for k, v in self.state_dict().items()})
        self._batch.state[...] = state_dict["integration_state"].cpu().numpy()
        with _engine_warnings():
            self._batch.forward(stage=mujoco.mjtStage.mjSTAGE_VEL)
        forces = {name: state_dict[name].cpu().clone().numpy() for name in _FORCES}
        self._now = self._read_motion() | forces


class _BodyReader:
    """Poses and twists of the tracked bodies, from the engine's float64 to float32.

    In NumPy and in blocks that fit the cache: torch would split this work among its threads,
    which on a busy machine wait for one another many times longer than the work takes.
    """

    BLOCK = 512

    def __init__(self, batch: Batch, robot: Robot) -> None:
        self._xpos, self._xquat = batch.bind("xpos"), batch.bind("xquat")
        self._cvel, self._com = batch.bind("cvel"), batch.bind("subtree_com")
        self._ids = robot.body_ids
        self._root_id = robot.pelvis_id

    def read(self, env_ids: np.ndarray | None = None) -> dict[str, np.ndarray]:
        """``PhysicsState``'s body fields, fresh float32 arrays; of everyone, or of ``env_ids``."""
        count, bodies = len(self._xpos if env_ids is None else env_ids), len(self._ids)
        widths = {"body_pos_w": 3, "body_quat_w": 4, "body_lin_vel_w": 3, "body_ang_vel_w": 3}
        out = {k: np.empty((count, bodies, width), np.float32) for k, width in widths.items()}
        for start in range(0, count, self.BLOCK):
            block = slice(start, start + self.BLOCK)
            rows = block if env_ids is None else env_ids[block]
            position = self._xpos[rows].take(self._ids, axis=1)
            out["body_pos_w"][block] = position
            out["body_quat_w"][block] = self._xquat[rows].take(self._ids, axis=1)
            twist = self._cvel[rows].take(self._ids, axis=1)
            linear, angular = body_twist(twist, position, self._com[rows, self._root_id])
            out["body_lin_vel_w"][block], out["body_ang_vel_w"][block] = linear, angular
        return out


@contextmanager
def _engine_warnings() -> Iterator[None]:
    """Keep MuJoCo from writing MUJOCO_LOG.TXT into the working folder, and lose no warning.

    That a simulation became unstable shows in its state; all else becomes a RuntimeWarning.
    """
    messages: list[str] = []
    before = mujoco.get_mju_user_warning()
    mujoco.set_mju_user_warning(messages.append)
    try:
        yield
    finally:
        mujoco.set_mju_user_warning(before)
    for message in dict.fromkeys(messages):
        if not message.startswith(_INSTABILITY):
            warnings.warn(f"MuJoCo: {message}", RuntimeWarning, stacklevel=4)
