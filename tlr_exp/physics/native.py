"""MuJoCo's C engine, one simulation per environment, on a pool of CPU threads."""

import copy
import warnings
from collections.abc import Iterator
from contextlib import contextmanager

import mujoco
import numpy as np
import torch
from mujoco.batch import Batch, SimulationError
from torch import Tensor

from tlr_exp.g1 import CONTROL_DT_S, DECIMATION, FOOT_BODIES, PELVIS
from tlr_exp.physics.state import (
    PhysicsState,
    body_twist,
    check_joint_target,
    check_reset,
    check_saved_state,
)
from tlr_exp.robot import Robot

_OUTPUTS = ("xpos", "xquat", "cvel", "subtree_com", "actuator_force", "sensordata")

_INSTABILITY = ("Nan, Inf or huge value", "Inertia matrix is too close to singular")


class NativePhysics:
    """``Physics`` on ``mujoco.batch``: the same bits at any number of threads.

    Args:
        robot: the robot; its model is copied.
        num_envs: number of simulations.
        num_threads: threads that share the simulations; 0 takes all cores.
        device: where the returned states live.

    Raises:
        ValueError: ``num_envs`` below 1 or ``num_threads`` below 0.
    """

    def __init__(
        self,
        robot: Robot,
        num_envs: int,
        num_threads: int = 0,
        device: torch.device | str = "cpu",
    ) -> None:
        if num_envs < 1:
            raise ValueError(f"num_envs is {num_envs}; at least one environment is needed")
        if num_threads < 0:
            raise ValueError(f"physics.num_threads is {num_threads}; 0 means all cores")
        self.num_envs = num_envs
        self.control_dt = CONTROL_DT_S
        self.device = torch.device(device)
        model = copy.copy(robot.model)
        # MuJoCo would put a diverged simulation back to its first pose without a word; what went
        # wrong must show instead.
        model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET
        # persistent: the kinematics of the new state, computed for the state that is returned,
        # are the first part of the next step and cost nothing.
        self._batch = Batch(model, num_envs, num_threads, persistent=True)
        self._body_ids = torch.from_numpy(robot.body_ids.astype(np.int64))
        self._root_id = int(robot.body_ids[PELVIS])
        self._foot_address = model.sensor(f"{FOOT_BODIES[0]}_contact").adr[0]
        self._qpos = torch.from_numpy(self._batch.bind("qpos"))
        self._qvel = torch.from_numpy(self._batch.bind("qvel"))
        self._ctrl = torch.from_numpy(self._batch.bind("ctrl"))
        self._out = {name: _read_only_view(self._batch.bind(name)) for name in _OUTPUTS}
        self._joint_torque = torch.zeros(num_envs, model.nu)
        self._foot_force = torch.zeros(num_envs, len(FOOT_BODIES), 3)
        self._batch.forward(stage=mujoco.mjtStage.mjSTAGE_VEL)

    def step(self, joint_target: Tensor) -> PhysicsState:
        """Advance one control step; see ``Physics.step``."""
        check_joint_target(joint_target, self.num_envs)
        self._ctrl.copy_(joint_target)
        try:
            with _engine_warnings():
                self._batch.step(nstep=DECIMATION, stage=mujoco.mjtStage.mjSTAGE_VEL)
        except SimulationError as error:
            # The engine refused these and left them where they were; the others went on. To
            # return the old state as if it were the new one would hide it.
            self._qpos[error.ids] = torch.nan
            self._qvel[error.ids] = torch.nan
            warnings.warn(str(error), RuntimeWarning, stacklevel=2)
        self._joint_torque = self._out["actuator_force"].float()
        feet = self._out["sensordata"][:, self._foot_address : self._foot_address + 6]
        self._foot_force = feet.reshape(self.num_envs, len(FOOT_BODIES), 3).float()
        return self.state()

    def set_state(self, env_ids: Tensor, qpos: Tensor, qvel: Tensor) -> None:
        """Reset some environments; see ``Physics.set_state``."""
        check_reset(env_ids, qpos, qvel, self.num_envs)
        env_ids, order = env_ids.cpu().sort()
        ids = env_ids.numpy()
        # reset discards what was written before it, so the new state is written after it.
        self._batch.reset(ids, stage=mujoco.mjtStage.mjSTAGE_NONE)
        self._qpos[env_ids] = qpos.cpu()[order].double()
        self._qvel[env_ids] = qvel.cpu()[order].double()
        with _engine_warnings():
            self._batch.forward(ids, stage=mujoco.mjtStage.mjSTAGE_VEL)
        # Not in place: a state that was returned earlier holds these tensors.
        self._joint_torque = self._joint_torque.index_fill(0, env_ids, 0.0)
        self._foot_force = self._foot_force.index_fill(0, env_ids, 0.0)

    def state(self) -> PhysicsState:
        """The current instant; see ``Physics.state``."""
        position = self._out["xpos"].index_select(1, self._body_ids)
        velocity = self._out["cvel"].index_select(1, self._body_ids)
        root_com = self._out["subtree_com"][:, self._root_id, None]
        linear, angular = body_twist(velocity, position, root_com)
        state = PhysicsState(
            qpos=self._qpos.float(),
            qvel=self._qvel.float(),
            body_pos_w=position.float(),
            body_quat_w=self._out["xquat"].index_select(1, self._body_ids).float(),
            body_lin_vel_w=linear.float(),
            body_ang_vel_w=angular.float(),
            joint_torque=self._joint_torque,
            foot_contact_force=self._foot_force,
            batch_size=[self.num_envs],
        )
        return state if self.device.type == "cpu" else state.to(self.device)

    def state_dict(self) -> dict[str, Tensor]:
        """MuJoCo's integration state (float64) and the outputs of the last physics step."""
        return {
            "integration_state": torch.from_numpy(self._batch.state.copy()),
            "joint_torque": self._joint_torque.clone(),
            "foot_contact_force": self._foot_force.clone(),
        }

    def load_state_dict(self, state_dict: dict[str, Tensor]) -> None:
        """Continue from ``state_dict``; see ``Physics.load_state_dict``."""
        check_saved_state(state_dict, {k: v.shape for k, v in self.state_dict().items()})
        self._batch.state[...] = state_dict["integration_state"].cpu().numpy()
        with _engine_warnings():
            self._batch.forward(stage=mujoco.mjtStage.mjSTAGE_VEL)
        self._joint_torque = state_dict["joint_torque"].cpu().clone()
        self._foot_force = state_dict["foot_contact_force"].cpu().clone()


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


def _read_only_view(array: np.ndarray) -> Tensor:
    """A tensor on the engine's output, which every call overwrites; nothing here writes to it."""
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message="The given NumPy array is not writable")
        return torch.from_numpy(array)
