"""Balance and inverse dynamics against hand arithmetic and MuJoCo's own simulation."""

from copy import copy

import mujoco
import numpy as np
import pytest
from standing import zero_moment_point

from tlr_exp.motion.authoring.keyframes import build_clip
from tlr_exp.motion.clip import clip_from_qpos
from tlr_exp.motion.dynamics import centroidal, inverse_dynamics

STAND = "keyframes: [{time_s: 0}, {time_s: 0.2}]"


@pytest.fixture(scope="module")
def standing(robot):
    return build_clip(STAND, robot)


def test_momentum_is_mass_times_velocity_and_that_of_mujoco(robot, swaying_clip):
    motion = centroidal(swaying_clip, robot)
    assert motion.mass == pytest.approx(robot.model.body_mass.sum())
    rate = np.gradient(motion.com, 1 / 50, axis=0)
    np.testing.assert_allclose(motion.com_vel[2:-2], rate[2:-2], atol=2e-3)
    data = mujoco.MjData(robot.model)
    data.qpos[:], data.qvel[:] = swaying_clip.qpos[40], swaying_clip.qvel[40]
    mujoco.mj_forward(robot.model, data)
    matrix = np.zeros((3, robot.model.nv))
    mujoco.mj_angmomMat(robot.model, data, matrix, 1)
    np.testing.assert_allclose(motion.angular_momentum[40], matrix @ data.qvel, atol=1e-9)


def test_zmp_of_standing_lies_below_the_centre_of_mass(robot, standing):
    com = centroidal(standing, robot).com
    np.testing.assert_allclose(zero_moment_point(standing, robot), com[:, :2], atol=1e-4)


def test_zmp_of_a_sliding_statue_lags_by_h_a_over_g(robot, standing):
    """A rigid robot accelerated forwards at 1 m/s^2 leans on a point h a / g behind it."""
    time = np.arange(11) / 50
    qpos = np.tile(standing.qpos[0], (11, 1))
    qpos[:, 0] += time**2 / 2
    clip = clip_from_qpos(qpos, 50.0, robot)
    com = centroidal(clip, robot).com
    zmp = zero_moment_point(clip, robot)
    np.testing.assert_allclose(com[:, 0] - zmp[:, 0], com[:, 2] / 9.81, rtol=1e-3)
    np.testing.assert_allclose(com[:, 1], zmp[:, 1], atol=1e-6)


def test_falling_has_no_zmp_and_needs_no_force(robot, standing):
    time = np.arange(11) / 50
    qpos = np.tile(standing.qpos[0], (11, 1))
    qpos[:, 2] += 1.0 - 9.81 * time**2 / 2
    clip = clip_from_qpos(qpos, 50.0, robot)
    assert np.isnan(zero_moment_point(clip, robot)).all()
    effort = inverse_dynamics(clip, robot)
    assert effort.unmet_force.max() < 1e-6
    np.testing.assert_allclose(effort.joint_torque, 0, atol=1e-6)
    np.testing.assert_array_equal(effort.foot_force, 0)


def test_feet_carry_the_weight(robot, standing):
    effort = inverse_dynamics(standing, robot)
    weight = robot.model.body_mass.sum() * 9.81
    np.testing.assert_allclose(effort.foot_force.sum(axis=1), weight, rtol=1e-4)
    np.testing.assert_allclose(effort.foot_force[:, 0], weight / 2, rtol=0.02)
    assert effort.unmet_force.max() < 0.1


def test_hovering_is_not_a_force_that_the_floor_can_give(robot, standing):
    qpos = np.tile(standing.qpos[0], (5, 1))
    qpos[:, 2] += 0.1
    effort = inverse_dynamics(clip_from_qpos(qpos, 50.0, robot), robot)
    weight = robot.model.body_mass.sum() * 9.81
    assert (effort.unmet_force > weight - 1).all()


def test_sliding_start_beyond_friction_is_unmet(robot, standing):
    """Friction 0.6 gives at most 0.6 g; 1 g forwards leaves a rest."""
    time = np.arange(5) / 50
    qpos = np.tile(standing.qpos[0], (5, 1))
    qpos[:, 0] += 9.81 * time**2 / 2
    assert inverse_dynamics(clip_from_qpos(qpos, 50.0, robot), robot).unmet_force.min() > 50


def test_torques_are_mujocos_inverse_dynamics_in_the_air(robot, swaying_qpos):
    high = swaying_qpos + np.eye(1, 30, 2)
    clip = clip_from_qpos(high, 50.0, robot)
    torque = inverse_dynamics(clip, robot).joint_torque
    model = copy(robot.model)
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
    data = mujoco.MjData(model)
    qacc = np.gradient(clip.qvel, 1 / 50, axis=0)
    for t in (10, 77):
        data.qpos[:], data.qvel[:], data.qacc[:] = clip.qpos[t], clip.qvel[t], qacc[t]
        mujoco.mj_inverse(model, data)
        np.testing.assert_allclose(torque[t], data.qfrc_inverse[6:], atol=1e-8)
