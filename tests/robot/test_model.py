"""The compiled robot says what the table says and follows the PD law."""

import mujoco
import numpy as np
import pytest

from tlr_exp.robot.g1 import G1
from tlr_exp.robot.model import Robot, build_robot, load_source

DEGREES_OF_FREEDOM = slice(6, 29)  # after the pelvis


@pytest.fixture(scope="module", params=G1.gain_sets)
def any_gains(request: pytest.FixtureRequest) -> Robot:
    return build_robot(gains=request.param)


def _contact_partners(model: mujoco.MjModel, geom_names: set[str]) -> set[frozenset[str]]:
    pairs = zip(model.pair_geom1, model.pair_geom2, strict=True)
    names = (frozenset(model.geom(geom).name for geom in pair) for pair in pairs)
    return {pair for pair in names if pair & geom_names}


def test_joints_come_in_the_order_of_the_table(any_gains: Robot) -> None:
    model = any_gains.model
    assert [model.joint(i).name for i in range(1, model.njnt)] == list(G1.joint_names)
    assert model.jnt_type[0] == mujoco.mjtJoint.mjJNT_FREE
    assert [model.actuator(i).name for i in range(model.nu)] == list(G1.joint_names)
    assert (model.nq, model.nv, model.nu) == (30, 29, 23)


def test_model_has_the_ranges_efforts_and_armature_of_the_table(any_gains: Robot) -> None:
    model = any_gains.model
    np.testing.assert_allclose(model.jnt_range[1:], any_gains.joint_range_rad, rtol=1e-12)
    assert model.jnt_limited[1:].all()
    effort = any_gains.effort_limit_nm
    np.testing.assert_array_equal(model.actuator_forcerange, np.column_stack([-effort, effort]))
    assert model.actuator_forcelimited.all()
    np.testing.assert_array_equal(model.dof_armature[DEGREES_OF_FREEDOM], any_gains.armature)
    assert (model.dof_damping == 0).all()
    assert (model.dof_frictionloss == 0).all()


def test_robot_carries_the_table_of_its_gains(any_gains: Robot) -> None:
    for name, column in G1.joint_tables(any_gains.gains).items():
        np.testing.assert_array_equal(getattr(any_gains, name), column)


def test_total_mass(any_gains: Robot) -> None:
    # Menagerie's model; the published figure is "about 35 kg".
    assert any_gains.model.body_mass.sum() == pytest.approx(33.341, abs=1e-3)


def test_simulation_options(any_gains: Robot) -> None:
    options = any_gains.model.opt
    assert options.timestep == 0.005
    assert options.integrator == mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    assert options.disableflags & mujoco.mjtDisableBit.mjDSBL_EULERDAMP
    np.testing.assert_array_equal(options.gravity, (0, 0, -9.81))


def test_body_ids_name_the_tracked_bodies(robot: Robot) -> None:
    names = [robot.model.body(i).name for i in robot.body_ids]
    assert names == list(G1.tracked_bodies)
    assert [robot.model.body(i).name for i in robot.foot_body_ids] == list(G1.foot_names)


def test_hands_and_head_sit_where_the_table_says_and_weigh_nothing(robot: Robot) -> None:
    expected = {
        "left_hand": ("left_elbow_link", (0.25, 0, 0)),
        "right_hand": ("right_elbow_link", (0.25, 0, 0)),
        "head": ("torso_link", (0, 0, 0.42)),
    }
    for name, (parent, offset) in expected.items():
        body = robot.model.body(name)
        assert robot.model.body(body.parentid[0]).name == parent
        np.testing.assert_array_equal(body.pos, offset)
        np.testing.assert_array_equal(body.quat, (1, 0, 0, 0))
        assert body.mass[0] == 0


@pytest.mark.parametrize("push", [0.05, 3.0])
def test_pd_law_clipped_at_the_effort(any_gains: Robot, push: float) -> None:
    """torque = kp (target - q) - kd qd within the effort, and the joint receives that torque."""
    generator = np.random.default_rng(0)
    data = mujoco.MjData(any_gains.model)
    data.qpos[2] = 2.0
    data.qpos[7:] = any_gains.default_joint_pos_rad
    data.qvel[DEGREES_OF_FREEDOM] = velocity = generator.normal(size=23)
    data.ctrl = any_gains.default_joint_pos_rad + push * generator.normal(size=23)
    mujoco.mj_forward(any_gains.model, data)
    wanted = any_gains.kp * (data.ctrl - data.qpos[7:]) - any_gains.kd * velocity
    effort = any_gains.effort_limit_nm
    np.testing.assert_allclose(data.actuator_force, np.clip(wanted, -effort, effort), rtol=1e-12)
    np.testing.assert_allclose(data.qfrc_actuator[DEGREES_OF_FREEDOM], data.actuator_force)
    assert (np.abs(wanted) > effort).any() == (push == 3.0)


def test_foot_sensors_report_the_force_on_the_foot(robot: Robot) -> None:
    data = mujoco.MjData(robot.model)
    data.qpos[2] = 0.75
    data.qpos[7:] = data.ctrl = robot.default_joint_pos_rad
    mujoco.mj_step(robot.model, data, nstep=60)
    feet = data.sensordata.reshape(2, 3)
    weight = robot.model.body_mass.sum() * 9.81
    assert feet[:, 2].sum() == pytest.approx(weight, rel=0.15)  # the floor pushes up
    assert feet[0, 2] == pytest.approx(feet[1, 2], rel=0.05)


def test_full_collisions_keep_every_pair_of_the_model_and_feet_only_six(robot: Robot) -> None:
    source = load_source().compile()
    assert robot.model.npair == source.npair == 49
    feet = build_robot(collisions="feet").model
    soles = {f"{side}_foot{i}_collision" for side in ("left", "right") for i in (1, 2, 3)}
    assert _contact_partners(feet, soles) == {frozenset({"floor", sole}) for sole in soles}
    assert feet.npair == 6


@pytest.mark.parametrize(("collisions", "rests"), [("full", True), ("feet", False)])
def test_a_lying_robot_rests_on_the_floor_only_with_full_collisions(
    collisions: str, rests: bool
) -> None:
    robot = build_robot(collisions=collisions)
    data = mujoco.MjData(robot.model)
    data.qpos[2:7] = (0.2, np.sqrt(0.5), 0, -np.sqrt(0.5), 0)  # on its back
    data.qpos[7:] = data.ctrl = robot.default_joint_pos_rad
    mujoco.mj_step(robot.model, data, nstep=200)
    assert (data.qpos[2] > 0.05) == rests


def test_pictures_keep_the_meshes_and_change_nothing_else(robot: Robot) -> None:
    pictured = build_robot(visuals=True).model
    assert pictured.nmesh > 0
    assert robot.model.nmesh == 0
    np.testing.assert_array_equal(pictured.body_mass, robot.model.body_mass)
    np.testing.assert_array_equal(pictured.body_inertia, robot.model.body_inertia)


def test_wrist_joints_actuators_sensors_and_keyframes_of_the_source_are_gone(robot: Robot) -> None:
    source = load_source().compile()
    assert source.njnt == 30
    assert "left_wrist_roll_joint" in {source.joint(i).name for i in range(source.njnt)}
    assert robot.model.nkey == 0
    assert [robot.model.sensor(i).name for i in range(robot.model.nsensor)] == [
        "left_ankle_roll_link_contact",
        "right_ankle_roll_link_contact",
    ]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"gains": "stiff"}, "env.robot.gains is 'stiff'; allowed: beyondmimic, asap"),
        ({"collisions": "none"}, "env.robot.collisions is 'none'; allowed: feet, full"),
    ],
)
def test_unknown_choice_names_the_alternatives(arguments: dict[str, str], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        build_robot(**arguments)
