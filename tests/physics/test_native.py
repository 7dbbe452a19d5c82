"""What only the C engine promises: same bits, exact resume, resets that touch nothing else."""

import io
import os
import subprocess
import sys
from pathlib import Path

import mujoco
import pytest
import torch

from tlr_exp.physics.native import NativePhysics
from tlr_exp.physics.state import PhysicsState

NUM_ENVS = 7


@pytest.fixture
def make(robot, start_states):
    """Fresh physics in the same moving start state at every call."""

    def build(num_threads: int = 2, num_envs: int = NUM_ENVS) -> NativePhysics:
        physics = NativePhysics(robot, num_envs, num_threads=num_threads)
        physics.set_state(torch.arange(num_envs), *start_states(num_envs, 0))
        return physics

    return build


def _run(physics: NativePhysics, joint_targets: torch.Tensor) -> list[PhysicsState]:
    return [physics.step(target) for target in joint_targets]


def _at(state: PhysicsState, env_ids: list[int]) -> PhysicsState:
    return state.at(torch.tensor(env_ids))


def test_same_bits_at_any_thread_count(make, targets, assert_same_bits) -> None:
    joint_targets = targets(NUM_ENVS, 15, 1)
    one, three = _run(make(1), joint_targets), _run(make(3), joint_targets)
    for left, right in zip(one, three, strict=True):
        assert_same_bits(left, right)


@pytest.mark.skipif(
    not hasattr(os, "sched_setaffinity") or os.cpu_count() == 1,
    reason="needs two cores to choose from",
)
def test_no_number_of_threads_means_the_cores_of_this_process_not_of_the_machine(robot):
    allowed = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {min(allowed)})
    try:
        assert NativePhysics(robot, 4, num_threads=0).num_threads == 1
        assert NativePhysics(robot, 4, num_threads=3).num_threads == 3
    finally:
        os.sched_setaffinity(0, allowed)


def test_reset_leaves_the_others_bit_for_bit(make, start_states, targets, assert_same_bits) -> None:
    joint_targets = targets(NUM_ENVS, 20, 2)
    left_alone, disturbed = make(), make()
    for step, target in enumerate(joint_targets):
        if step in (3, 4, 11):
            before = disturbed.state()
            disturbed.set_state(torch.tensor([5, 1]), *start_states(2, step))
            assert_same_bits(_at(before, [0, 2, 3, 4, 6]), _at(disturbed.state(), [0, 2, 3, 4, 6]))
        expected, found = left_alone.step(target), disturbed.step(target)
        assert_same_bits(_at(expected, [0, 2, 3, 4, 6]), _at(found, [0, 2, 3, 4, 6]))
    assert not torch.equal(expected.qpos[[1, 5]], found.qpos[[1, 5]])


def test_reset_environment_forgets_its_past(make, start_states, targets, assert_same_bits) -> None:
    """Warm start, contacts and controls of the old episode do not reach into the new one."""
    joint_targets = targets(NUM_ENVS, 20, 3)
    used = make()
    _run(used, joint_targets[:10])
    used.set_state(torch.arange(NUM_ENVS), *start_states(NUM_ENVS, 0))
    assert_same_bits(used.state(), make().state())
    for left, right in zip(
        _run(used, joint_targets[10:]), _run(make(), joint_targets[10:]), strict=True
    ):
        assert_same_bits(left, right)


def test_reset_in_any_order_puts_each_state_where_it_belongs(make, start_states) -> None:
    physics = make()
    qpos, qvel = start_states(3, 9)
    physics.set_state(torch.tensor([6, 0, 3]), qpos, qvel)
    state = physics.state()
    assert torch.equal(state.qpos[[6, 0, 3]], qpos)
    assert torch.equal(state.qvel[[6, 0, 3]], qvel)
    assert torch.allclose(state.body_pos_w[[6, 0, 3], 0], qpos[:, :3], atol=1e-6)


def test_torque_and_contact_force_are_zero_after_a_reset_only(make, targets, start_states) -> None:
    physics = make()
    for target in targets(NUM_ENVS, 5, 4):
        moving = physics.step(target)
    kept = moving.at(torch.arange(NUM_ENVS))
    physics.set_state(torch.tensor([2]), *start_states(1, 5))
    after = physics.state()
    assert torch.equal(after.joint_torque[2], torch.zeros(23))
    assert torch.equal(after.foot_contact_force[2], torch.zeros(2, 3))
    assert torch.equal(after.joint_torque[3], moving.joint_torque[3])
    # What was handed out before stays what it was.
    assert torch.equal(moving.joint_torque, kept.joint_torque)
    assert torch.equal(moving.foot_contact_force, kept.foot_contact_force)


def test_returned_state_is_not_overwritten_by_the_next_step(
    make, targets, assert_same_bits
) -> None:
    physics = make()
    first, second = targets(NUM_ENVS, 2, 6)
    state = physics.step(first)
    kept = state.at(torch.arange(NUM_ENVS))
    physics.step(second)
    assert_same_bits(state, kept)


@pytest.mark.parametrize("saved_threads", [1, 2])
def test_resume_from_a_file_continues_bit_for_bit(
    make, robot, start_states, targets, assert_same_bits, saved_threads: int
) -> None:
    joint_targets = targets(NUM_ENVS, 45, 7)
    physics = make(saved_threads)
    _run(physics, joint_targets[:20])
    physics.set_state(torch.tensor([4]), *start_states(1, 8))
    _run(physics, joint_targets[20:25])
    buffer = io.BytesIO()
    torch.save(physics.state_dict(), buffer)
    saved_instant = physics.state()
    expected = _run(physics, joint_targets[25:])

    buffer.seek(0)
    fresh = NativePhysics(robot, NUM_ENVS, num_threads=2)
    fresh.load_state_dict(torch.load(buffer, weights_only=True))
    assert_same_bits(fresh.state(), saved_instant)
    for left, right in zip(expected, _run(fresh, joint_targets[25:]), strict=True):
        assert_same_bits(left, right)


def test_loaded_state_is_a_copy(make, targets) -> None:
    physics = make()
    saved = physics.state_dict()
    kept = {name: value.clone() for name, value in saved.items()}
    other = make()
    other.load_state_dict(saved)
    _run(other, targets(NUM_ENVS, 3, 10))
    _run(physics, targets(NUM_ENVS, 3, 10))
    assert all(torch.equal(saved[name], kept[name]) for name in saved)


def test_saved_state_that_does_not_fit_is_refused(make) -> None:
    saved = make().state_dict()
    with pytest.raises(ValueError, match="resume with num_envs=7"):
        make(num_envs=3).load_state_dict(saved)
    saved["integration_state"] = saved["integration_state"][:, :-1]
    with pytest.raises(ValueError, match="another robot"):
        make().load_state_dict(saved)


@pytest.mark.parametrize(
    ("field", "value"), [("_qpos", torch.nan), ("_qvel", torch.inf), ("_qvel", 1e30)]
)
def test_unstable_environment_shows_harms_no_other_and_is_revived(
    make, start_states, targets, assert_same_bits, monkeypatch, tmp_path, field: str, value: float
) -> None:
    monkeypatch.chdir(tmp_path)
    joint_targets = targets(NUM_ENVS, 12, 11)
    healthy, poisoned = make(), make()
    getattr(poisoned, field)[4, 12] = value
    others = [0, 1, 2, 3, 5, 6]
    for target in joint_targets[:6]:
        expected, found = healthy.step(target), poisoned.step(target)
        assert_same_bits(_at(expected, others), _at(found, others))
        assert not torch.isfinite(found.qpos[4]).all()
    # An instability outlives saving and loading; it is not repaired on the way.
    poisoned.load_state_dict(poisoned.state_dict())
    assert not torch.isfinite(poisoned.state().qpos[4]).all()

    qpos, qvel = start_states(1, 12)
    healthy.set_state(torch.tensor([4]), qpos, qvel)
    poisoned.set_state(torch.tensor([4]), qpos, qvel)
    for target in joint_targets[6:]:
        assert_same_bits(healthy.step(target), poisoned.step(target))
    assert not list(tmp_path.iterdir()), "MuJoCo wrote its log into the working folder"


def test_simulation_that_the_engine_refuses_is_returned_as_not_finite(
    make, start_states, targets, assert_same_bits
) -> None:
    joint_targets = targets(NUM_ENVS, 4, 13)
    healthy, broken = make(), make()
    transmission = broken._batch.expand("actuator_trntype")
    transmission[2] = 99  # mj_transmission raises "unknown transmission type"
    others = [0, 1, 3, 4, 5, 6]
    for target in joint_targets:
        expected = healthy.step(target)
        with pytest.warns(RuntimeWarning, match="1 of 7 simulations.*unknown transmission type"):
            found = broken.step(target)
        assert_same_bits(_at(expected, others), _at(found, others))
        assert torch.isnan(found.qpos[2]).all()
        assert torch.isnan(found.qvel[2]).all()
    transmission[2] = mujoco.mjtTrn.mjTRN_JOINT
    broken.set_state(torch.tensor([2]), *start_states(1, 14))
    assert torch.isfinite(broken.step(joint_targets[0]).qpos).all()


def test_engine_warnings_of_another_kind_reach_python(robot, monkeypatch) -> None:
    physics = NativePhysics(robot, 1, num_threads=0)
    step = physics._batch.step

    def noisy_step(**arguments: int) -> None:
        mujoco.get_mju_user_warning()("a buffer is full")
        step(**arguments)

    monkeypatch.setattr(physics._batch, "step", noisy_step)
    before = mujoco.get_mju_user_warning()
    with pytest.warns(RuntimeWarning, match="MuJoCo: a buffer is full"):
        physics.step(torch.zeros(1, 23))
    assert mujoco.get_mju_user_warning() is before


def test_the_robot_s_own_model_is_left_alone(robot) -> None:
    flags = robot.model.opt.disableflags
    NativePhysics(robot, 1, num_threads=0)
    assert robot.model.opt.disableflags == flags
    assert not flags & mujoco.mjtDisableBit.mjDSBL_AUTORESET


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"num_envs": 0, "num_threads": 0}, "num_envs is 0"),
        ({"num_envs": 1, "num_threads": -1}, "num_threads is -1"),
    ],
)
def test_impossible_sizes_are_refused(robot, arguments: dict[str, int], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        NativePhysics(robot, **arguments)


def test_wrong_target_is_refused_before_anything_moves(make) -> None:
    physics = make()
    before = physics.state_dict()["integration_state"]
    with pytest.raises(ValueError, match="not finite"):
        physics.step(torch.full((NUM_ENVS, 23), torch.nan))
    assert torch.equal(physics.state_dict()["integration_state"], before)


def test_native_physics_never_imports_jax(tmp_path: Path) -> None:
    code = "import sys, tlr_exp.physics.native; sys.exit('jax' in sys.modules)"
    subprocess.run([sys.executable, "-c", code], check=True, cwd=tmp_path, timeout=120)
