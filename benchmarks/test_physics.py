"""What the physics wrapper costs beside MuJoCo's own batched step, as a ratio in one run."""

import copy
import time

import mujoco
import numpy as np
import pytest
import torch
from mujoco.batch import Batch

from tlr_exp.physics.native import NativePhysics
from tlr_exp.robot.model import build_robot
from tlr_exp.robot.timing import DECIMATION

ROUNDS = 40
WANTED_RATIO = 0.9


@pytest.mark.parametrize("num_envs", [512, 4096])
def test_native_step_against_a_bare_batch(num_envs, benchmark):
    """Time of a bare step over that of ``NativePhysics.step``, target in and state out.

    Both run the same trajectory, step by step in turn, so that they have the same contacts to
    solve and a machine that changes its pace changes it for both. The bare batch has nothing
    bound, no foot sensors to evaluate and nobody who looks at its results.
    """
    robot = build_robot()
    physics = NativePhysics(robot, num_envs, num_threads=0)
    generator = torch.Generator().manual_seed(0)
    default = torch.from_numpy(robot.default_joint_pos_rad).float()
    qpos = torch.zeros(num_envs, 30)
    qpos[:, 2], qpos[:, 3], qpos[:, 7:] = 0.75, 1.0, default
    qvel = 0.3 * torch.randn(num_envs, 29, generator=generator)
    physics.set_state(torch.arange(num_envs), qpos, qvel)
    joint_target = default + 0.1 * torch.randn(num_envs, 23, generator=generator)

    without_sensors = copy.copy(robot.model)
    without_sensors.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_SENSOR
    bare = Batch(without_sensors, num_envs, persistent=True)
    bare.bind("qpos")[:] = qpos.numpy()
    bare.bind("qvel")[:] = qvel.numpy()
    bare.bind("ctrl")[:] = joint_target.numpy()
    bare.forward(stage=mujoco.mjtStage.mjSTAGE_VEL)
    bare_s, whole_s = [], []

    def alternate():
        start = time.perf_counter()
        bare.step(nstep=DECIMATION, stage=mujoco.mjtStage.mjSTAGE_VEL)
        middle = time.perf_counter()
        physics.step(joint_target)
        bare_s.append(middle - start)
        whole_s.append(time.perf_counter() - middle)

    benchmark.pedantic(alternate, rounds=ROUNDS, warmup_rounds=2)
    ratio = sorted(b / w for b, w in zip(bare_s, whole_s, strict=True))[len(bare_s) // 2]
    benchmark.extra_info.update(
        ratio=ratio,
        bare_steps_per_s=num_envs / min(bare_s),
        steps_per_s=num_envs / min(whole_s),
    )
    print(f"\n{num_envs} environments: {ratio:.3f} of a bare batch's speed")
    # The same trajectory to the last bit: the comparison was of like with like.
    assert np.array_equal(bare.bind("qpos"), physics._qpos)
    assert ratio >= WANTED_RATIO
