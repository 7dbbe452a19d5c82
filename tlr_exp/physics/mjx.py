"""MuJoCo XLA: all robots stepped by one compiled program, on an accelerator or the CPU.

The one module that imports jax. It keeps of each robot only what a step starts from (``qpos``,
``qvel`` and the solver's warm start); all else is computed anew inside the compiled program.
"""

import contextlib
import copy
import io
import os
import warnings
from collections.abc import Callable
from typing import Any, Literal, get_args

import jax
import mujoco
import numpy as np
import torch
from jax import numpy as jnp
from jax._src.xla_bridge import backends_are_initialized
from torch import Tensor

from tlr_exp.config.checks import check_at_least, check_choice
from tlr_exp.errors import UserError
from tlr_exp.machine.variables import cache_folder
from tlr_exp.physics.state import PhysicsState, check_joint_target, check_reset, check_saved_state
from tlr_exp.robot.model import Robot
from tlr_exp.robot.timing import CONTROL_DT_S, DECIMATION

with contextlib.redirect_stdout(io.StringIO()):  # it prints that warp is missing
    from mujoco import mjx
    from mujoco.mjx import warp as mjx_warp

_ITERATION_LIMITS = 1 << 9 | 1 << 10  # MuJoCo Warp's OverflowType.ITERATIONS and LS_ITERATIONS
Implementation = Literal["jax", "warp"]
Arrays = dict[str, jax.Array]


class MjxPhysics:
    """``Physics`` on MuJoCo XLA, compiled when it is made.

    The tensors of a returned state are JAX's own memory, passed on without a copy.

    Args:
        robot, num_envs: the robot, whose model is copied, and the number of simulations.
        impl: ``jax``, or ``warp`` for MuJoCo Warp, which needs the package warp-lang.
        max_contacts: contacts that ``warp`` has room for, a robot on average.
        max_constraints: constraint rows that ``warp`` has room for, in each robot.
        device: ``cpu`` or ``cuda``; None takes CUDA where torch finds it.

    Raises:
        UserError: an unknown ``impl``, a number below 1, a package that ``impl`` or ``device``
            needs is missing, or a model that ``impl`` cannot simulate.
    """

    disturbances = ("push_m_s",)  # the compiled program has one model for all robots

    def __init__(
        self,
        robot: Robot,
        num_envs: int,
        impl: Implementation,
        max_contacts: int,
        max_constraints: int,
        device: torch.device | str | None = None,
    ) -> None:
        check_at_least("num_envs", num_envs, 1)
        self.check_settings(impl, max_contacts, max_constraints)
        _check_package(impl)
        spec = self.spec = robot.spec
        self.num_envs = num_envs
        self.control_dt = CONTROL_DT_S
        default = "cuda" if torch.cuda.is_available() else "cpu"
        device = torch.device(default if device is None else device)
        # With its number, as the tensors have it.
        self.device = torch.device("cuda", device.index or 0) if device.type == "cuda" else device
        _configure_jax(self.device)
        with jax.default_device(_find_jax_device(self.device)):
            room = {"naconmax": num_envs * max_contacts, "njmax": max_constraints}
            advance = _advance_program(robot, impl, room if impl == "warp" else {})
            step = _batched_step(advance, _kinematics_program(robot))
            restart = _batched_restart(_kinematics_program(robot))
            # Compiled for these shapes now: no later call can set off a second compilation.
            widths = (spec.num_qpos, spec.num_qvel, spec.num_qvel, spec.num_joints)
            state = [jnp.zeros((num_envs, width)) for width in widths]
            self._step = jax.jit(step).lower(*state).compile()
            # Run once, too: MuJoCo Warp compiles its kernels at their first use.
            self._arrays: Arrays = jax.block_until_ready(self._step(*state))
            mask = jnp.zeros(num_envs, bool)
            self._restart = jax.jit(restart).lower(self._arrays, mask, *state[:2]).compile()
        qpos0 = torch.from_numpy(robot.model.qpos0).expand(num_envs, -1)
        self.set_state(torch.arange(num_envs), qpos0, torch.zeros(num_envs, spec.num_qvel))

    @staticmethod
    def check_settings(impl: str, max_contacts: int, max_constraints: int) -> None:
        """Refuse what the constructor refuses, before it compiles for a minute."""
        check_choice("impl", impl, get_args(Implementation))
        check_at_least("max_contacts", max_contacts, 1)
        check_at_least("max_constraints", max_constraints, 1)

    def _to_jax(self, value: Tensor) -> jax.Array:
        if value.is_floating_point():
            value = value.to(getattr(torch, self._arrays["qpos"].dtype.name))
        return jax.dlpack.from_dlpack(value.detach().to(self.device).contiguous())

    def step(self, joint_target: Tensor) -> PhysicsState:
        """Advance one control step; see ``Physics.step``."""
        check_joint_target(joint_target, self.num_envs, self.spec)
        now = self._arrays
        start = (now["qpos"], now["qvel"], now["qacc_warmstart"])
        # Wait: the target's memory is the caller's again afterwards.
        self._arrays = jax.block_until_ready(self._step(*start, self._to_jax(joint_target)))
        return self.state()

    def set_state(self, env_ids: Tensor, qpos: Tensor, qvel: Tensor) -> None:
        """Reset some environments; see ``Physics.set_state``."""
        check_reset(env_ids, qpos, qvel, self.num_envs, self.spec)
        if env_ids.numel() == 0:
            return
        env_ids = env_ids.to(self.device)
        mask = torch.zeros(self.num_envs, device=self.device).index_fill(0, env_ids, 1.0) > 0.0

        def spread(rows: Tensor) -> jax.Array:
            everywhere = torch.zeros(self.num_envs, rows.shape[1], device=self.device)
            everywhere[env_ids] = rows.to(everywhere)
            return self._to_jax(everywhere)

        inputs = (self._to_jax(mask), spread(qpos), spread(qvel))
        self._arrays = jax.block_until_ready(self._restart(self._arrays, *inputs))

    def push(self, env_ids: Tensor, velocity: Tensor) -> None:
        """Change the velocity of some robots; see ``Physics.push``."""
        qvel = torch.from_dlpack(self._arrays["qvel"]).clone()
        qvel[env_ids.to(self.device), :3] += velocity.to(qvel)
        self._arrays = {**self._arrays, "qvel": self._to_jax(qvel)}

    def state(self) -> PhysicsState:
        """The current instant; see ``Physics.state``."""
        fields = PhysicsState._fields
        return PhysicsState(*(torch.from_dlpack(self._arrays[name]).float() for name in fields))

    def state_dict(self) -> dict[str, Tensor]:
        """The state, the solver's warm start and the outputs of the last physics step."""
        return {name: torch.from_dlpack(a).to("cpu", copy=True) for name, a in self._arrays.items()}

    def load_state_dict(self, state_dict: dict[str, Tensor]) -> None:
        """Continue from ``state_dict``; see ``Physics.load_state_dict``."""
        check_saved_state(state_dict, {name: a.shape for name, a in self._arrays.items()})
        self._arrays = {name: self._to_jax(state_dict[name].clone()) for name in self._arrays}


def _batched_step(advance: Callable, kinematics: Callable) -> Callable:
    def step(qpos: jax.Array, qvel: jax.Array, warmstart: jax.Array, target: jax.Array) -> Arrays:
        moved = jax.vmap(advance)(qpos, qvel, warmstart, target)
        return moved | jax.vmap(kinematics)(moved["qpos"], moved["qvel"])

    return step


def _batched_restart(kinematics: Callable) -> Callable:
    def restart(arrays: Arrays, mask: jax.Array, qpos: jax.Array, qvel: jax.Array) -> Arrays:
        fresh = {name: jnp.zeros_like(value) for name, value in arrays.items()}
        fresh |= {"qpos": qpos, "qvel": qvel} | jax.vmap(kinematics)(qpos, qvel)

        rows = {name: mask.reshape(-1, *[1] * (old.ndim - 1)) for name, old in arrays.items()}
        return {name: jnp.where(rows[name], fresh[name], old) for name, old in arrays.items()}

    return restart


def _advance_program(robot: Robot, impl: str, room: dict[str, Any]) -> Callable:
    """One control step of one robot: (qpos, qvel, warm start, target) to the same and forces."""
    model = _without_sensors(robot.model) if impl == "jax" else robot.model
    if impl == "warp":
        mjx_warp.warp.config.quiet = True  # or it prints every kernel that it loads
    try:
        mjx_model = mjx.put_model(model, impl=impl)
    except NotImplementedError as error:
        raise UserError(
            f"physics.impl={impl} cannot simulate this robot ({error}); take physics=native"
        ) from error
    if impl == "warp":
        # Five solver iterations are the model's choice, not worth a printed line at every step.
        options: Any = mjx_model.opt._impl
        quiet = {"opt._impl.warn_overflow": options.warn_overflow & ~_ITERATION_LIMITS}
        mjx_model = mjx_model.tree_replace(quiet)
    blank = mjx.make_data(model, impl=impl, **room)
    foot_address = int(robot.model.sensor(f"{robot.spec.foot_names[0]}_contact").adr[0])

    def foot_force(data: mjx.Data) -> jax.Array:
        if impl == "warp":
            return data.sensordata[foot_address : foot_address + 6].reshape(2, 3)
        return _net_contact_force(model, data, robot.foot_body_ids)

    def advance(
        qpos: jax.Array, qvel: jax.Array, warmstart: jax.Array, target: jax.Array
    ) -> Arrays:
        def substep(now: Arrays, _: None) -> tuple[Arrays, None]:
            start = {name: now[name] for name in ("qpos", "qvel", "qacc_warmstart")}
            data = mjx.step(mjx_model, blank.replace(ctrl=target, **start))
            moved = {name: getattr(data, name) for name in start}
            moved |= {"joint_torque": data.actuator_force, "foot_contact_force": foot_force(data)}
            return moved, None

        now = {"qpos": qpos, "qvel": qvel, "qacc_warmstart": warmstart}
        now |= {"joint_torque": jnp.zeros(model.nu), "foot_contact_force": jnp.zeros((2, 3))}
        return jax.lax.scan(substep, now, length=DECIMATION)[0]

    return advance


def _kinematics_program(robot: Robot) -> Callable:
    """Poses and twists of one robot's bodies: a step leaves those of one substep before."""
    model = _without_sensors(robot.model)
    mjx_model = mjx.put_model(model, impl="jax")
    blank = mjx.make_data(model, impl="jax")
    bodies, root = robot.body_ids, robot.pelvis_id

    def kinematics(qpos: jax.Array, qvel: jax.Array) -> Arrays:
        data = blank.replace(qpos=qpos, qvel=qvel)
        for stage in (mjx.kinematics, mjx.com_pos, mjx.com_vel):
            data = stage(mjx_model, data)
        angular, linear = data.cvel[bodies, :3], data.cvel[bodies, 3:]
        # As in state.body_twist: the twist is about the centre of mass of the whole robot.
        arm = data.xpos[bodies] - data.subtree_com[root]
        return {
            "body_pos_w": data.xpos[bodies],
            "body_quat_w": data.xquat[bodies],
            "body_lin_vel_w": linear + jnp.cross(angular, arm),
            "body_ang_vel_w": angular,
        }

    return kinematics


def _net_contact_force(model: mujoco.MjModel, data: mjx.Data, body_ids: np.ndarray) -> jax.Array:
    """Net contact force on each body, N in the world frame, [bodies, 3].

    The JAX implementation lacks the contact sensor that the other engines read this from.
    """
    internals: Any = data._impl
    contact, rows = internals.contact, internals.efc_force
    total = jnp.zeros((len(body_ids), 3))
    owner = jnp.asarray(model.geom_bodyid)[contact.geom]  # [contacts, 2]
    for dim in sorted(set(contact.dim.tolist())):
        which = np.flatnonzero(contact.dim == dim)
        if dim == 1 or model.opt.cone == mujoco.mjtCone.mjCONE_ELLIPTIC:
            along = rows[contact.efc_address[which, None] + np.arange(min(dim, 3))]
        else:  # opposite edges of the friction pyramid share the normal and pull on a tangent
            edges = rows[contact.efc_address[which, None] + np.arange(2 * (dim - 1))]
            pull = (edges[:, 0:4:2] - edges[:, 1:4:2]) * contact.friction[which, :2]
            along = jnp.concatenate([edges.sum(axis=1, keepdims=True), pull], axis=1)
        # The frame's rows are the normal and two tangents.
        force = jnp.einsum("ck,ckx->cx", along, contact.frame[which, : along.shape[1]])
        # The force acts on the second geom of the contact, and its opposite on the first.
        sign = (owner[which, 1] == body_ids[:, None]).astype(rows.dtype)
        sign -= owner[which, 0] == body_ids[:, None]
        total += sign @ force
    return total


def _without_sensors(model: mujoco.MjModel) -> mujoco.MjModel:
    """The model for the JAX implementation, which refuses body-level contact sensors."""
    model = copy.copy(model)
    model.sensor_type[:] = mujoco.mjtSensor.mjSENS_CLOCK
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_SENSOR
    return model


def _check_package(impl: str) -> None:
    if impl == "warp" and not mjx_warp.WARP_INSTALLED:
        raise UserError(
            "physics.impl=warp needs the package warp-lang: pip install -e '.[gpu]', "
            "or take physics.impl=jax"
        )


def _find_jax_device(device: torch.device) -> Any:
    try:
        return jax.devices("gpu" if device.type == "cuda" else device.type)[device.index or 0]
    except RuntimeError as error:
        raise UserError(
            f"physics.device is {device}, but JAX finds no such device ({error}): "
            "pip install -e '.[gpu]', or take device=cpu"
        ) from error


def _configure_jax(device: torch.device) -> None:
    if device.type == "cpu":
        # With more threads, a scan over mjx.step under vmap can leave all of XLA's CPU threads
        # asleep for ever; with one it also runs faster. XLA reads this at its first use.
        if backends_are_initialized() and os.environ.get("NPROC") != "1":
            hint = "jax was used before MjxPhysics was made and may hang on the CPU: set NPROC=1"
            warnings.warn(hint, RuntimeWarning, stacklevel=3)
        os.environ["NPROC"] = "1"
    os.environ.setdefault("XLA_PYTHON_CLIENT_PREALLOCATE", "false")  # torch needs memory, too
    # Reduced-precision products (TF32) spoil contacts.
    jax.config.update("jax_default_matmul_precision", "highest")
    cache = cache_folder()
    if jax.config.values["jax_compilation_cache_dir"] is None and cache is not None:
        jax.config.update("jax_compilation_cache_dir", str(cache / "jax"))
