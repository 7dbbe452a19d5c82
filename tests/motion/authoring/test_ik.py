"""Inverse kinematics: what it reaches, and what it says where it cannot."""

import dataclasses

import mujoco
import numpy as np
import pytest

from tlr_exp.motion.authoring.ik import BodySolver, HandSolver
from tlr_exp.motion.authoring.plan import LIMIT_MARGIN_RAD, BodyTargets
from tlr_exp.robot.g1 import G1


@pytest.fixture(scope="module")
def targets(robot) -> BodyTargets:
    """Five frames that lower, turn and tilt the pelvis above two feet that stand still."""
    steps = np.linspace(0, 1, 5)
    joints = np.zeros((5, 23))
    joints[:, G1.joint_names.index("left_elbow_joint")] = steps
    half = 0.1 * steps
    return BodyTargets(
        times_s=steps,
        com_xy=np.stack([0.03 + 0.01 * steps, 0.05 * steps], axis=1),
        pelvis_height=0.75 - 0.05 * steps,
        pelvis_quat=np.stack([np.cos(half), 0 * half, np.sin(half), 0 * half], axis=1),
        foot_pos=np.array([[[0.0, 0.12, 0.035]] * 5, [[0.05, -0.12, 0.035]] * 5]),
        foot_quat=np.tile([1.0, 0.0, 0.0, 0.0], (2, 5, 1)),
        joint_pos=joints,
    )


def test_all_targets_are_met(robot, targets):
    data = mujoco.MjData(robot.model)
    for t, qpos in enumerate(BodySolver(robot).solve(targets)):
        data.qpos[:] = qpos
        mujoco.mj_kinematics(robot.model, data)
        mujoco.mj_comPos(robot.model, data)
        np.testing.assert_allclose(
            data.xpos[robot.foot_body_ids], targets.foot_pos[:, t], atol=1e-5
        )
        np.testing.assert_allclose(
            data.xquat[robot.foot_body_ids], targets.foot_quat[:, t], atol=1e-5
        )
        np.testing.assert_allclose(data.subtree_com[1][:2], targets.com_xy[t], atol=1e-5)
        np.testing.assert_allclose(qpos[2], targets.pelvis_height[t], atol=1e-5)
        np.testing.assert_allclose(qpos[3:7], targets.pelvis_quat[t], atol=1e-5)
        np.testing.assert_allclose(qpos[7 + 12 :], targets.joint_pos[t, 12:], atol=1e-5)


def test_a_height_of_the_centre_of_mass_goes_before_that_of_the_pelvis(robot, targets):
    falling = dataclasses.replace(targets, com_height=np.linspace(0.68, 0.62, 5))
    solver, data = BodySolver(robot), mujoco.MjData(robot.model)
    for qpos, height in zip(solver.solve(falling), falling.com_height, strict=True):
        data.qpos[:] = qpos
        mujoco.mj_kinematics(robot.model, data)
        mujoco.mj_comPos(robot.model, data)
        np.testing.assert_allclose(data.subtree_com[1][2], height, atol=1e-5)
    # A draft keeps to the pelvis, and so does the next motion without flight.
    for qpos in (solver.solve(falling, strict=False), solver.solve(targets)):
        np.testing.assert_allclose(qpos[:, 2], targets.pelvis_height, atol=1e-5)


@pytest.mark.parametrize("strict", [True, False])
def test_out_of_reach_is_refused_with_time_and_joints(robot, targets, strict):
    far = targets.foot_pos.copy()
    far[1, 3, 1] = -0.4
    with pytest.raises(ValueError, match=r"at 0\.75 s .* misses .* mm; .*ankle_roll_joint"):
        BodySolver(robot).solve(dataclasses.replace(targets, foot_pos=far), strict)


def test_a_draft_may_use_the_margin_and_a_clip_may_not(robot, targets):
    wide = targets.foot_pos.copy()
    wide[1, :, 1] = -0.22
    targets = dataclasses.replace(targets, foot_pos=wide)
    qpos = BodySolver(robot).solve(targets, strict=False)
    low, high = robot.joint_range_rad.T
    room = np.minimum(qpos[:, 7:] - low, high - qpos[:, 7:]).min()
    assert -1e-6 < room < LIMIT_MARGIN_RAD
    with pytest.raises(ValueError, match=r"at .* s the .* misses its target"):
        BodySolver(robot).solve(targets)


@pytest.mark.parametrize("side", ["left", "right"])
def test_hand_gets_to_its_target(robot, side):
    sign = 1 if side == "left" else -1
    target = [0.3, sign * 0.2, 0.2]
    angles = HandSolver(robot)(side, target, [0.2, sign * 0.2, 0.0, 0.6])
    data = mujoco.MjData(robot.model)
    data.qpos[3] = 1.0
    first = 7 + G1.joint_names.index(f"{side}_shoulder_pitch_joint")
    data.qpos[first : first + 4] = angles
    mujoco.mj_kinematics(robot.model, data)
    torso = data.body("torso_link").xpos
    np.testing.assert_allclose(data.body(f"{side}_hand").xpos - torso, target, atol=0.005)
    low, high = robot.joint_range_rad[first - 7 : first - 3].T
    assert (np.minimum(angles - low, high - angles) > LIMIT_MARGIN_RAD - 1e-6).all()


def test_hand_out_of_reach_is_refused(robot):
    with pytest.raises(ValueError, match=r"the left hand misses \[1.0, 0.0, 0.0\] by \d+ mm"):
        HandSolver(robot)("left", [1.0, 0.0, 0.0], [0.0, 0.0, 0.0, 0.0])
