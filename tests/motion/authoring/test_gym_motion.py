"""The gym-motion: the poses of the paper's Figure 5, and a motion that a real G1 could do."""

import mujoco
import numpy as np
import pytest
from standing import support_margin, zero_moment_point

from tlr_exp.motion.authoring.balance import SLOW_SPEED_M_S
from tlr_exp.motion.clip import kinematics_error
from tlr_exp.motion.dynamics import centroidal, inverse_dynamics
from tlr_exp.motion.feet import foot_extremes, sole_points
from tlr_exp.robot.g1 import G1

LIMIT_MARGIN_RAD = 0.05
MAX_JOINT_JERK_RAD_S3 = 1000.0
MAX_PELVIS_JERK_M_S3 = 60.0


@pytest.fixture(scope="module")
def pose(gym_clip, gym_plan):
    """Positions of a body at a named keyframe."""

    def of(keyframe: str, body: str) -> np.ndarray:
        (time,) = (t for name, t in gym_plan.names.items() if name.startswith(keyframe))
        return gym_clip.body_pos_w[round(time * gym_clip.fps), G1.tracked_bodies.index(body)]

    return of


@pytest.fixture(scope="module")
def soles(robot, gym_clip):
    """Lowest points of the feet over time [2, T] and sole points in the world [2][T, n, 3]."""
    lowest, points = [], []
    for side, foot in enumerate(("left_ankle_roll_link", "right_ankle_roll_link")):
        body = G1.tracked_bodies.index(foot)
        rotations = np.empty((gym_clip.num_frames, 9))
        for t, quat in enumerate(gym_clip.body_quat_w[:, body]):
            mujoco.mju_quat2Mat(rotations[t], quat)
        rotations, origin = rotations.reshape(-1, 3, 3), gym_clip.body_pos_w[:, None, body]
        centres, radii = foot_extremes(robot, side)
        spheres = origin + centres @ rotations.transpose(0, 2, 1)
        lowest.append((spheres[..., 2] - radii).min(axis=1))
        points.append(origin + sole_points(robot, side) @ rotations.transpose(0, 2, 1))
    return np.array(lowest), points


@pytest.fixture(scope="module")
def support(gym_plan, soles):
    """Points over the floor of the feet that carry the robot, per frame."""
    on_floor = np.array([foot.on_floor for foot in gym_plan.feet])
    return [
        np.concatenate([soles[1][side][t][:, :2] for side in range(2) if on_floor[side, t]])
        for t in range(on_floor.shape[1])
    ]


# --- the poses of Figure 5 -------------------------------------------------------------------


def test_eight_poses_in_about_eight_seconds_at_50_hz(gym_clip, gym_plan):
    assert gym_clip.fps == 50.0
    assert gym_clip.duration_s == pytest.approx(8.0, abs=0.5)
    assert [name[0] for name in gym_plan.names] == ["n", *"12345678"]


def test_pose_1_is_a_step_to_the_right(pose):
    step = pose("1", "right_ankle_roll_link") - pose("neutral", "right_ankle_roll_link")
    assert step[1] < -0.1
    assert abs(step[0]) < 0.01


def test_pose_2_has_the_weight_on_the_right_and_the_arms_going_out(pose):
    feet = (pose("2", "right_ankle_roll_link") + pose("2", "left_ankle_roll_link")) / 2
    assert pose("2", "pelvis")[1] < feet[1] - 0.03
    assert pose("2", "left_hand")[1] > pose("1", "left_hand")[1] + 0.05
    assert pose("1", "right_hand")[1] > pose("2", "right_hand")[1] + 0.15


def test_pose_3_has_the_arms_sideways_at_shoulder_height(pose):
    for side, sign in (("left", 1), ("right", -1)):
        arm = pose("3", f"{side}_hand") - pose("3", f"{side}_shoulder_roll_link")
        assert abs(arm[2]) < 0.06
        assert sign * arm[1] > 0.4


def test_pose_4_is_a_step_to_the_left(pose):
    assert pose("4", "right_ankle_roll_link")[1] > pose("3", "right_ankle_roll_link")[1] + 0.1
    assert pose("4", "pelvis")[1] > pose("3", "pelvis")[1] + 0.15


def test_poses_5_and_6_face_forward_with_the_hands_rising_overhead(pose):
    for side in ("left", "right"):
        assert pose("5", f"{side}_hand")[2] > pose("5", f"{side}_shoulder_pitch_link")[2]
        assert pose("6", f"{side}_hand")[2] > pose("6", "head")[2] + 0.15
    assert abs(pose("5", "left_hand")[0] - pose("5", "right_hand")[0]) < 0.01


def test_poses_7_and_8_return_by_the_right_with_the_arms_lowered(pose):
    assert pose("7", "pelvis")[1] < pose("6", "pelvis")[1] - 0.03
    for keyframe in "78":
        for side in ("left", "right"):
            assert pose(keyframe, f"{side}_hand")[2] < pose(keyframe, "torso_link")[2]


def test_first_and_last_pose_are_alike_and_at_rest(gym_clip):
    np.testing.assert_allclose(gym_clip.qpos[-1], gym_clip.qpos[0], atol=2e-3)
    for frame in (0, -1):
        assert np.abs(gym_clip.qvel[frame]).max() < 0.02


# --- what a real robot could do --------------------------------------------------------------


def test_body_poses_are_those_of_the_joints(gym_clip, robot):
    assert max(kinematics_error(gym_clip, robot)) < 1e-9


def test_standing_feet_do_not_slide(gym_plan, soles):
    for side, foot in enumerate(gym_plan.feet):
        starts = np.flatnonzero(np.diff(np.concatenate([[0], foot.on_floor]).astype(int)) > 0)
        ends = np.flatnonzero(np.diff(np.concatenate([foot.on_floor, [0]]).astype(int)) < 0)
        for start, end in zip(starts, ends, strict=True):
            stance = soles[1][side][start : end + 1, :, :2]
            assert np.linalg.norm(stance - stance[0], axis=-1).max() < 0.005
        assert len(starts) == (1 if side == 0 else 3)


def test_soles_stay_above_and_standing_soles_on_the_floor(gym_plan, soles):
    for lowest, foot in zip(soles[0], gym_plan.feet, strict=True):
        assert lowest.min() > -0.005
        assert lowest[foot.on_floor].max() < 0.005
        if not foot.on_floor.all():
            assert lowest.max() > 0.03


def test_joints_keep_a_margin_from_their_limits(gym_clip, robot):
    low, high = robot.joint_range_rad.T
    joints = gym_clip.qpos[:, 7:]
    assert np.minimum(joints - low, high - joints).min() > LIMIT_MARGIN_RAD - 1e-6


def test_knees_stay_bent(gym_clip):
    knees = [7 + i for i, name in enumerate(G1.joint_names) if "knee" in name]
    assert gym_clip.qpos[:, knees].min() > 0.3


def test_joint_speeds_stay_below_half_of_the_motors_limits(gym_clip, robot):
    share = np.abs(gym_clip.qvel[:, 6:]) / robot.velocity_limit_rad_s
    assert share.max() < 0.5


def test_jerk_is_bounded_at_the_joins_too(gym_clip):
    """A jump of acceleration by 20 rad/s^2 within a frame would make 1000 rad/s^3 of jerk."""
    jerk = np.diff(gym_clip.qvel, n=2, axis=0) * gym_clip.fps**2
    assert np.abs(jerk[:, 6:]).max() < MAX_JOINT_JERK_RAD_S3
    assert np.abs(jerk[:, :3]).max() < MAX_PELVIS_JERK_M_S3


def test_centre_of_mass_is_over_the_feet_while_it_moves_slowly(gym_clip, robot, support):
    motion = centroidal(gym_clip, robot)
    speed = np.linalg.norm(motion.com_vel[:, :2], axis=1)
    slow = np.flatnonzero(speed < SLOW_SPEED_M_S)
    assert len(slow) > 0.6 * gym_clip.num_frames
    assert min(support_margin(support[t], motion.com[t, :2]) for t in slow) > 0.0


def test_zero_moment_point_stays_within_the_feet(gym_clip, robot, support):
    zmp = zero_moment_point(gym_clip, robot)
    margins = [support_margin(points, zmp[t]) for t, points in enumerate(support)]
    assert min(margins) > 0.002


def test_floor_and_motors_can_give_the_forces(gym_clip, robot):
    effort = inverse_dynamics(gym_clip, robot)
    assert effort.unmet_force.max() < 1.0
    assert (np.abs(effort.joint_torque) / robot.effort_limit_nm).max() < 0.5


def test_nothing_touches_but_feet_and_floor(gym_clip, robot):
    data, model = mujoco.MjData(robot.model), robot.model
    for qpos in gym_clip.qpos:
        data.qpos[:] = qpos
        mujoco.mj_forward(model, data)
        for contact in data.contact[: data.ncon]:
            bodies = {int(model.geom_bodyid[geom]) for geom in contact.geom}
            assert bodies <= {0, *robot.foot_body_ids}
            assert 0 in bodies


@pytest.mark.parametrize("start", [0, 60, 190, 300])
def test_mujoco_follows_the_motion_for_a_second_without_feedback(gym_clip, robot, start):
    """The torques of inverse dynamics, through the position actuators, carry the robot along.

    Only stiff joints correct errors; a motion that broke the laws of mechanics would drift within
    a few frames.
    """
    torque = inverse_dynamics(gym_clip, robot).joint_torque
    data = mujoco.MjData(robot.model)
    data.qpos[:], data.qvel[:] = gym_clip.qpos[start], gym_clip.qvel[start]
    for t in range(start, start + 50):
        for part in (0.25, 0.5, 0.75, 1.0):
            joints, speeds, torques = (
                (1 - part) * rows[t] + part * rows[t + 1]
                for rows in (gym_clip.qpos[:, 7:], gym_clip.qvel[:, 6:], torque)
            )
            data.ctrl[:] = joints + (torques + robot.kd * speeds) / robot.kp
            mujoco.mj_step(robot.model, data)
    assert np.linalg.norm(data.qpos[:3] - gym_clip.qpos[start + 50, :3]) < 0.04
