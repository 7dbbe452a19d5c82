"""What only MJX promises: no copies, no writes, one compilation, no hang, helpful refusals."""

import copy
import os
import subprocess
import sys
from dataclasses import replace

import mujoco
import pytest
import torch

from tlr_exp.physics import mjx as mjx_physics
from tlr_exp.physics.mjx import MjxPhysics
from tlr_exp.physics.state import PhysicsState

NUM_ENVS = 8
SETTINGS = {"num_envs": 1, "impl": "jax", "max_contacts": 35, "max_constraints": 250}


@pytest.fixture
def physics(make_mjx, start_states) -> MjxPhysics:
    """The session's one compiled engine, put back to the same moving start."""
    engine = make_mjx("jax", "cpu")
    engine.set_state(torch.arange(NUM_ENVS), *start_states(NUM_ENVS, 0))
    return engine


def _run(physics: MjxPhysics, joint_targets: torch.Tensor) -> list[PhysicsState]:
    return [physics.step(target) for target in joint_targets]


def _others(state: PhysicsState, *left_out: int) -> PhysicsState:
    return state.at(torch.tensor([i for i in range(NUM_ENVS) if i not in left_out]))


def test_reset_leaves_the_others_bit_for_bit(
    physics, start_states, targets, assert_same_bits
) -> None:
    joint_targets = targets(NUM_ENVS, 12, 2)
    expected = _run(physics, joint_targets)
    physics.set_state(torch.arange(NUM_ENVS), *start_states(NUM_ENVS, 0))
    for step, target in enumerate(joint_targets):
        if step in (3, 4, 9):
            before = physics.state()
            physics.set_state(torch.tensor([5, 1]), *start_states(2, step))
            assert_same_bits(_others(before, 1, 5), _others(physics.state(), 1, 5))
        found = physics.step(target)
        assert_same_bits(_others(expected[step], 1, 5), _others(found, 1, 5))
    assert not torch.equal(expected[-1].qpos[[1, 5]], found.qpos[[1, 5]])


def test_reset_in_any_order_puts_each_state_where_it_belongs(physics, start_states) -> None:
    qpos, qvel = start_states(3, 9)
    physics.set_state(torch.tensor([6, 0, 3]), qpos, qvel)
    state = physics.state()
    assert torch.equal(state.qpos[[6, 0, 3]], qpos)
    assert torch.equal(state.qvel[[6, 0, 3]], qvel)
    assert torch.equal(state.joint_torque[[6, 0, 3]], torch.zeros(3, 23))
    assert torch.equal(state.foot_contact_force[[6, 0, 3]], torch.zeros(3, 2, 3))


def test_reset_of_nothing_changes_nothing(physics, assert_same_bits) -> None:
    before = physics.state().at(torch.arange(NUM_ENVS))
    physics.set_state(torch.empty(0, dtype=torch.int64), torch.zeros(0, 30), torch.zeros(0, 29))
    assert_same_bits(physics.state(), before)


def test_saved_state_continues_bit_for_bit(
    physics, start_states, targets, assert_same_bits
) -> None:
    joint_targets = targets(NUM_ENVS, 30, 7)
    _run(physics, joint_targets[:10])
    saved, instant = physics.state_dict(), physics.state().at(torch.arange(NUM_ENVS))
    expected = _run(physics, joint_targets[10:])
    physics.set_state(torch.arange(NUM_ENVS), *start_states(NUM_ENVS, 99))
    physics.load_state_dict(saved)
    assert_same_bits(physics.state(), instant)
    for left, right in zip(expected, _run(physics, joint_targets[10:]), strict=True):
        assert_same_bits(left, right)


def test_saved_state_of_another_engine_is_refused(physics) -> None:
    with pytest.raises(ValueError, match="saved by another engine"):
        physics.load_state_dict({"integration_state": torch.zeros(NUM_ENVS, 100)})


def test_arrays_cross_to_torch_without_a_copy(physics, targets) -> None:
    state = physics.step(targets(NUM_ENVS, 1, 3)[0])
    for name, array in physics._arrays.items():
        if name != "qacc_warmstart":
            assert getattr(state, name).data_ptr() == array.unsafe_buffer_pointer(), name


def test_nothing_writes_into_what_was_handed_out(
    physics, start_states, targets, assert_same_bits
) -> None:
    """Memory is shared with JAX, which takes its arrays to be constant."""
    joint_targets = targets(NUM_ENVS, 3, 4)
    handed_out = [physics.state(), *_run(physics, joint_targets)]
    kept = [state.at(torch.arange(NUM_ENVS)) for state in handed_out]
    saved = physics.state_dict()
    physics.set_state(torch.tensor([2, 4]), *start_states(2, 5))
    physics.load_state_dict(saved)
    _run(physics, joint_targets)
    for left, right in zip(handed_out, kept, strict=True):
        assert_same_bits(left, right)


def test_the_caller_s_tensors_are_free_to_change_after_a_call(
    physics, start_states, targets, assert_same_bits
) -> None:
    """Also where the tensor starts amid its memory, as a row of a rollout does."""
    joint_targets = targets(NUM_ENVS, 5, 6)
    expected = _run(physics, joint_targets)
    qpos, qvel = start_states(NUM_ENVS, 0)
    physics.set_state(torch.arange(NUM_ENVS), qpos, qvel)
    qpos.fill_(torch.nan)
    qvel.fill_(torch.nan)
    buffer = torch.empty(NUM_ENVS * 23 + 1)[1:].view(NUM_ENVS, 23)
    for target, right in zip(joint_targets, expected, strict=True):
        left = physics.step(buffer.copy_(target))
        buffer.fill_(torch.nan)
        assert_same_bits(left, right)


def test_unstable_environment_shows_harms_no_other_and_is_revived(
    physics, start_states, targets, assert_same_bits
) -> None:
    joint_targets = targets(NUM_ENVS, 6, 11)
    expected = _run(physics, joint_targets)
    physics.set_state(torch.arange(NUM_ENVS), *start_states(NUM_ENVS, 0))
    poisoned = physics.state_dict()
    poisoned["qpos"][4, 12] = torch.nan
    physics.load_state_dict(poisoned)
    for target, right in zip(joint_targets, expected, strict=True):
        left = physics.step(target)
        assert_same_bits(_others(left, 4), _others(right, 4))
        assert not torch.isfinite(left.qpos[4]).all()
    physics.set_state(torch.tensor([4]), *start_states(1, 12))
    assert torch.isfinite(physics.step(joint_targets[0]).qpos).all()


def test_wrong_target_is_refused(physics) -> None:
    with pytest.raises(ValueError, match="not finite"):
        physics.step(torch.full((NUM_ENVS, 23), torch.nan))


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"num_envs": 0}, "num_envs is 0"),
        ({"impl": "cuda"}, "impl is 'cuda'; allowed: jax, warp"),
        ({"max_contacts": 0}, "max_contacts is 0; allowed: at least 1"),
        ({"max_constraints": -2}, "max_constraints is -2; allowed: at least 1"),
    ],
)
def test_impossible_arguments_are_refused(robot, arguments: dict, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        MjxPhysics(robot, **SETTINGS | arguments)


def test_missing_warp_names_the_extra_to_install(robot, monkeypatch) -> None:
    monkeypatch.setattr(mjx_physics.mjx_warp, "WARP_INSTALLED", False)
    with pytest.raises(ValueError, match=r"warp-lang: pip install -e '\.\[gpu\]'"):
        MjxPhysics(robot, **SETTINGS | {"impl": "warp"})


@pytest.mark.skipif(torch.cuda.is_available(), reason="there is a CUDA device")
def test_missing_cuda_is_refused(robot) -> None:
    with pytest.raises(ValueError, match=r"device is cuda:0, but JAX finds no such device"):
        MjxPhysics(robot, **SETTINGS, device="cuda")


def test_model_beyond_mjx_is_refused(robot) -> None:
    model = copy.copy(robot.model)
    model.opt.solver = mujoco.mjtSolver.mjSOL_PGS
    with pytest.raises(ValueError, match=r"cannot simulate this robot .*PGS.*physics=native"):
        MjxPhysics(replace(robot, model=model), **SETTINGS)


def _run_python(code: str, timeout_s: float) -> subprocess.CompletedProcess[str]:
    """Run code in a fresh process that has no NPROC and takes RuntimeWarnings for errors."""
    return subprocess.run(
        [sys.executable, "-W", "error::RuntimeWarning", "-c", code],
        env={name: value for name, value in os.environ.items() if name != "NPROC"},
        capture_output=True,
        text=True,
        check=False,
        timeout=timeout_s,
    )


def test_jax_on_the_cpu_gets_one_thread(physics) -> None:
    assert os.environ["NPROC"] == "1"


def test_jax_used_too_early_is_told() -> None:
    finished = _run_python(
        "import jax\n"
        "jax.devices('cpu')\n"
        "from tlr_exp.physics.mjx import MjxPhysics\n"
        "from tlr_exp.robot.model import build_robot\n"
        "MjxPhysics(build_robot(), 1, 'jax', 35, 250, device='cpu')\n",
        timeout_s=120,
    )
    assert "RuntimeWarning: jax was used before MjxPhysics was made" in finished.stderr
    assert finished.stdout == ""


@pytest.mark.slow
def test_256_environments_step_on_two_cpu_threads_without_hanging() -> None:
    """With NPROC=2 this never returns: all of XLA's threads fall asleep in the first step."""
    finished = _run_python(
        "import torch\n"
        "from tlr_exp.physics.mjx import MjxPhysics\n"
        "from tlr_exp.robot.model import build_robot\n"
        "physics = MjxPhysics(build_robot(), 256, 'jax', 35, 250, device='cpu')\n"
        "for _ in range(3):\n"
        "    state = physics.step(torch.zeros(256, 23))\n"
        "print(torch.isfinite(state.qpos).all().item())\n",
        timeout_s=600,
    )
    assert finished.stdout == "True\n", finished.stderr


@pytest.mark.gpu
@pytest.mark.skipif(not torch.cuda.is_available(), reason="no CUDA device")
def test_resume_and_sharing_on_a_gpu(make_mjx, start_states, targets, assert_same_bits) -> None:
    physics = make_mjx("jax", "cuda")
    joint_targets = targets(NUM_ENVS, 10, 7).cuda()
    physics.set_state(torch.arange(NUM_ENVS), *start_states(NUM_ENVS, 0))
    _run(physics, joint_targets[:5])
    saved = physics.state_dict()
    assert all(value.device.type == "cpu" for value in saved.values())
    expected = _run(physics, joint_targets[5:])
    assert expected[-1].qpos.device.type == "cuda"
    assert expected[-1].qpos.data_ptr() == physics._arrays["qpos"].unsafe_buffer_pointer()
    physics.load_state_dict(saved)
    found = _run(physics, joint_targets[5:])
    # Sums on a GPU may run in another order, so that this is close and not bit for bit.
    torch.testing.assert_close(found[-1].qpos, expected[-1].qpos, atol=1e-4, rtol=0)
