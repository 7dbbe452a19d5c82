"""What the environment and the collector cost beside the bare physics, as a ratio in one run."""

import time

import mujoco
import pytest
import torch
from hydra import compose, initialize_config_module
from tensordict.nn import TensorDictModule

from tlr_exp import keys
from tlr_exp.assembly.environment import build_env
from tlr_exp.assembly.terms import terms_of_training
from tlr_exp.assembly.world import build_clip, build_robot_of
from tlr_exp.config.load import load_settings
from tlr_exp.physics.native import NativePhysics
from tlr_exp.robot.g1 import G1
from tlr_exp.robot.timing import DECIMATION
from tlr_exp.training.build import build_collect

NUM_STEPS = 24
ROUNDS = 10
WANTED_RATIO = 0.85


@pytest.mark.parametrize("num_envs", [512, 4096])
def test_environment_against_bare_physics(num_envs, benchmark):
    """Bare stepping time over the time of everything (observations, terms, resets, collector).

    On one core, the engine's part and the environment's alike: with more threads the engine gets
    faster and the rest does not, so the ratio would be one of the number of cores.

    Both start from the same states and receive the same targets; rounds alternate between them,
    so that a machine that changes its pace changes it for both.
    """
    with initialize_config_module("tlr_exp.conf", version_base="1.3"):
        settings = load_settings(
            compose("config", [f"scale.num_envs={num_envs}", "physics.num_threads=1"])
        )
    robot = build_robot_of(settings.env)
    clip = build_clip(settings.env, robot)
    env = build_env(settings, robot, clip, terms_of_training(settings))
    bare = NativePhysics(robot, num_envs, num_threads=1)
    generator = torch.Generator().manual_seed(0)
    action = 0.3 * torch.randn(num_envs, G1.num_joints, generator=generator)
    policy = TensorDictModule(lambda _: action, in_keys=[keys.OBSERVATION], out_keys=[keys.ACTION])
    collect = build_collect(env, policy, NUM_STEPS)
    collect()
    bare_s, whole_s = [], []
    targets = env.joint_targets

    def alternate():
        bare.load_state_dict(env.physics.state_dict())
        bare_s.append(_bare_seconds(bare, targets.default_pos + targets.scale * action))
        start = time.perf_counter()
        collect()
        whole_s.append(time.perf_counter() - start)

    benchmark.pedantic(alternate, rounds=ROUNDS, warmup_rounds=1)
    ratio = sorted(b / w for b, w in zip(bare_s, whole_s, strict=True))[len(bare_s) // 2]
    benchmark.extra_info.update(
        ratio=ratio,
        bare_steps_per_s=num_envs * NUM_STEPS / min(bare_s),
        steps_per_s=num_envs * NUM_STEPS / min(whole_s),
    )
    print(f"\n{num_envs} environments: {ratio:.2f} of the bare physics' speed")
    assert ratio >= WANTED_RATIO


def _bare_seconds(physics: NativePhysics, target: torch.Tensor) -> float:
    batch = physics._batch
    batch.bind("ctrl")[:] = target.numpy()
    start = time.perf_counter()
    for _ in range(NUM_STEPS):
        batch.step(nstep=DECIMATION, stage=mujoco.mjtStage.mjSTAGE_VEL)
    return time.perf_counter() - start
