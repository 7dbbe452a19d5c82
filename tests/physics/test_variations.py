"""Robots that differ from their model, and pushes: what fields say, and what the engine does."""

import mujoco
import numpy as np
import pytest
import torch

from tlr_exp.physics.native import NativePhysics

NUM_ENVS = 4
EVERYONE = torch.arange(NUM_ENVS)
FREE_FALL_M_S2 = 9.81


@pytest.fixture
def make(robot, start_states):
    def build(values: dict[str, torch.Tensor] | None = None) -> NativePhysics:
        physics = NativePhysics(robot, NUM_ENVS, num_threads=2)
        if values:
            physics.vary(EVERYONE, values)
        physics.set_state(EVERYONE, *start_states(NUM_ENVS, 0))
        return physics

    return build


@pytest.fixture(scope="module")
def standing(robot):
    """State and target of a robot that stands with its knees bent, feet on the floor."""
    default = torch.from_numpy(robot.default_joint_pos_rad).float().expand(NUM_ENVS, -1)
    root = torch.tensor([0.0, 0.0, 0.757, 1.0, 0.0, 0.0, 0.0]).expand(NUM_ENVS, -1)
    return torch.cat((root, default), dim=1), torch.zeros(NUM_ENVS, 29), default


@pytest.fixture(scope="module")
def values():
    """Something else for every robot, of everything."""
    generator = torch.Generator().manual_seed(0)

    def draw(*shape: int) -> torch.Tensor:
        return 0.8 + 0.4 * torch.rand(NUM_ENVS, *shape, generator=generator)

    return {
        "friction": draw(),
        "mass": draw(34),
        "com_m": 0.05 * draw(3),
        "kp": draw(23),
        "kd": draw(23),
        "armature": draw(23),
    }


def test_every_field_is_the_model_s_own_by_the_values(robot, make, values):
    physics = make(values)
    torso = robot.model.body("torso_link").id
    for env in range(NUM_ENVS):
        ours, model = physics._batch.get_model(env), robot.model
        value = {name: each[env].double().numpy() for name, each in values.items()}
        np.testing.assert_allclose(ours.geom_friction[:, 0], value["friction"])
        np.testing.assert_allclose(ours.pair_friction[:, :2], value["friction"])
        np.testing.assert_allclose(ours.body_mass, model.body_mass * value["mass"])
        np.testing.assert_allclose(ours.body_inertia, model.body_inertia * value["mass"][:, None])
        np.testing.assert_allclose(ours.body_ipos[torso], model.body_ipos[torso] + value["com_m"])
        np.testing.assert_allclose(ours.actuator_gainprm[:, 0], robot.kp * value["kp"])
        np.testing.assert_allclose(ours.actuator_biasprm[:, 1], -robot.kp * value["kp"])
        np.testing.assert_allclose(ours.actuator_biasprm[:, 2], -robot.kd * value["kd"])
        np.testing.assert_allclose(ours.dof_armature[6:], robot.armature * value["armature"])
        np.testing.assert_array_equal(ours.dof_armature[:6], model.dof_armature[:6])
        # Constants that MuJoCo derives have followed.
        np.testing.assert_allclose(ours.body_subtreemass[0], ours.body_mass.sum())


def test_a_varied_robot_is_the_one_that_a_model_with_these_values_gives(
    robot, make, values, start_states, targets
):
    physics = make(values)
    qpos, qvel = start_states(NUM_ENVS, 0)
    model = physics._batch.get_model(2)
    mujoco.mj_setConst(model, mujoco.MjData(model))
    data = mujoco.MjData(model)
    data.qpos, data.qvel = qpos[2].numpy(), qvel[2].numpy()
    for target in targets(NUM_ENVS, 10, 1):
        state = physics.step(target)
        data.ctrl = target[2].numpy()
        mujoco.mj_step(model, data, nstep=4)
    np.testing.assert_allclose(state.qpos[2], data.qpos, atol=1e-6)


def test_the_model_s_own_values_change_no_bit(make, targets, assert_same_bits):
    ones = {name: torch.ones(NUM_ENVS, 23) for name in ("kp", "kd", "armature")}
    ones |= {"mass": torch.ones(NUM_ENVS, 34), "com_m": torch.zeros(NUM_ENVS, 3)}
    varied, plain = make(ones), make()
    for target in targets(NUM_ENVS, 10, 2):
        assert_same_bits(varied.step(target), plain.step(target))


def test_values_do_not_add_up_and_the_others_stay_bit_for_bit(
    make, values, start_states, targets, assert_same_bits
):
    once, twice = make(values), make(values)
    script = targets(NUM_ENVS, 12, 3)
    for step, target in enumerate(script):
        if step == 5:
            ids = torch.tensor([3, 1])
            state = start_states(2, 7)
            once.set_state(ids, *state)
            other = {name: 0.5 * value[ids] for name, value in values.items()}
            twice.vary(ids, other)
            twice.vary(ids, {name: value[ids] for name, value in values.items()})
            twice.set_state(ids, *state)
        assert_same_bits(once.step(target), twice.step(target))


def test_a_heavier_robot_presses_harder_on_the_floor(robot, standing):
    factors = torch.tensor([0.8, 1.0, 1.1, 1.3])
    physics = NativePhysics(robot, NUM_ENVS, num_threads=1)
    physics.vary(EVERYONE, {"mass": factors[:, None].expand(-1, 34)})
    qpos, qvel, target = standing
    physics.set_state(EVERYONE, qpos, qvel)
    pressed = torch.zeros(NUM_ENVS)
    for step in range(50):
        state = physics.step(target)
        if step >= 25:
            pressed += state.foot_contact_force[:, :, 2].sum(dim=1) / 25
    weight = factors * robot.model.body_mass.sum() * FREE_FALL_M_S2
    assert torch.allclose(pressed, weight.float(), rtol=0.1)
    assert (pressed.diff() > 20.0).all()


def test_a_robot_slides_farther_on_a_smoother_floor(robot, standing):
    physics = NativePhysics(robot, NUM_ENVS, num_threads=1)
    physics.vary(EVERYONE, {"friction": torch.tensor([0.02, 0.1, 0.3, 1.0])})
    qpos, qvel, target = standing
    qvel = qvel.clone()
    qvel[:, 0] = 1.0
    physics.set_state(EVERYONE, qpos, qvel)
    for _ in range(5):
        state = physics.step(target)
    feet = state.body_pos_w[:, [6, 12], 0].mean(dim=1)
    assert (feet.diff() < -0.01).all()


def test_stiffer_gains_pull_harder_and_damping_brakes(robot, standing):
    qpos, qvel, target = standing
    factors = torch.tensor([0.5, 1.0, 1.5, 2.0])[:, None].expand(-1, 23)
    elbow = 18
    for name, sign in (("kp", 1.0), ("kd", -1.0)):
        physics = NativePhysics(robot, NUM_ENVS, num_threads=1)
        physics.vary(EVERYONE, {name: factors})
        velocity = qvel.clone()
        velocity[:, 6 + elbow] = 2.0 if name == "kd" else 0.0
        physics.set_state(EVERYONE, qpos, velocity)
        ahead = target.clone()
        ahead[:, elbow] += 0.3 if name == "kp" else 0.0
        torque = physics.step(ahead).joint_torque[:, elbow]
        assert (sign * torque.diff() > 0.0).all(), name


def test_a_larger_armature_makes_a_joint_slower_to_start(robot, standing):
    qpos, qvel, target = standing
    physics = NativePhysics(robot, NUM_ENVS, num_threads=1)
    factors = torch.tensor([0.5, 1.0, 4.0, 16.0])[:, None].expand(-1, 23)
    physics.vary(EVERYONE, {"armature": factors})
    physics.set_state(EVERYONE, qpos, qvel)
    ahead = target.clone()
    ahead[:, 18] += 0.3
    moved = physics.step(ahead).qpos[:, 7 + 18] - qpos[:, 7 + 18]
    assert (moved.diff() < 0.0).all()


def test_a_robot_whose_torso_is_heavier_in_front_leans_there(robot, standing):
    qpos, qvel, target = standing
    physics = NativePhysics(robot, NUM_ENVS, num_threads=1)
    offset = torch.zeros(NUM_ENVS, 3)
    offset[:, 0] = torch.tensor([-0.1, 0.0, 0.05, 0.1])
    physics.vary(EVERYONE, {"com_m": offset})
    physics.set_state(EVERYONE, qpos, qvel)
    for _ in range(25):
        state = physics.step(target)
    lean = 2.0 * state.qpos[:, 5]  # about y, forwards
    assert (lean.diff() > 0.0).all()


def test_a_push_is_the_velocity_that_a_plain_simulation_is_given(
    robot, make, start_states, targets
):
    physics = make()
    qpos, qvel = start_states(NUM_ENVS, 0)
    data = mujoco.MjData(robot.model)
    data.qpos, data.qvel = qpos[1].numpy(), qvel[1].numpy()
    for step, target in enumerate(targets(NUM_ENVS, 10, 4)):
        if step in (4, 7):
            physics.push(torch.tensor([3, 1]), torch.tensor([[9.0, 9.0, 9.0], [0.3, -0.2, 0.1]]))
            data.qvel[:3] += np.array([0.3, -0.2, 0.1], np.float32)
        state = physics.step(target)
        data.ctrl = target[1].numpy()
        mujoco.mj_step(robot.model, data, nstep=4)
    np.testing.assert_allclose(state.qpos[1], data.qpos, atol=1e-6)
    np.testing.assert_allclose(state.qvel[1], data.qvel, atol=1e-5)


def test_a_push_leaves_the_others_bit_for_bit(make, targets):
    pushed, left_alone = make(), make()
    for step, target in enumerate(targets(NUM_ENVS, 8, 5)):
        if step == 3:
            pushed.push(torch.tensor([2]), torch.tensor([[0.4, 0.0, 0.0]]))
        found, expected = pushed.step(target), left_alone.step(target)
        for value, other in zip(found, expected, strict=True):
            assert torch.equal(value[[0, 1, 3]], other[[0, 1, 3]])
    assert not torch.equal(found.qpos[2], expected.qpos[2])


def test_a_pushed_simulation_that_went_wrong_stays_so(make, targets):
    physics = make()
    physics._qvel[2, 3] = torch.nan
    first, second = targets(NUM_ENVS, 2, 6)
    physics.step(first)
    physics.push(torch.tensor([2]), torch.tensor([[0.4, 0.0, 0.0]]))
    assert not torch.isfinite(physics.step(second).qvel[2]).all()


def test_mjx_pushes_as_the_c_engine_does(make, make_mjx, start_states, targets):
    mjx, native = make_mjx(), make()
    qpos, qvel = start_states(8, 0)
    qpos[:, 2] += 1.0  # in the air, where both agree longest
    mjx.set_state(torch.arange(8), qpos, qvel)
    native.set_state(EVERYONE, qpos[:NUM_ENVS], qvel[:NUM_ENVS])
    velocity = torch.tensor([[0.5, -0.25, 0.0]])
    for step, target in enumerate(targets(8, 6, 7)):
        if step == 2:
            mjx.push(torch.tensor([1]), velocity)
            native.push(torch.tensor([1]), velocity)
        found, expected = mjx.step(target), native.step(target[:NUM_ENVS])
    assert torch.allclose(found.qpos[:NUM_ENVS], expected.qpos, atol=1e-4)
    assert torch.allclose(found.qvel[:NUM_ENVS], expected.qvel, atol=5e-3)
