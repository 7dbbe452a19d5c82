"""The numbers of the 23-joint G1, held to the published table, left and right written out."""

import math

import numpy as np
import pytest

from tlr_exp.robot.g1 import G1
from tlr_exp.robot.timing import CONTROL_DT_S, DECIMATION, SIM_DT_S

# joint: range (rad), effort (N m), velocity (rad/s)
LIMITS = {
    "left_hip_pitch_joint": (-2.5307, 2.8798, 88, 32),
    "left_hip_roll_joint": (-0.5236, 2.9671, 139, 20),
    "left_hip_yaw_joint": (-2.7576, 2.7576, 88, 32),
    "left_knee_joint": (-0.0873, 2.8798, 139, 20),
    "left_ankle_pitch_joint": (-0.8727, 0.5236, 50, 37),
    "left_ankle_roll_joint": (-0.2618, 0.2618, 50, 37),
    "right_hip_pitch_joint": (-2.5307, 2.8798, 88, 32),
    "right_hip_roll_joint": (-2.9671, 0.5236, 139, 20),
    "right_hip_yaw_joint": (-2.7576, 2.7576, 88, 32),
    "right_knee_joint": (-0.0873, 2.8798, 139, 20),
    "right_ankle_pitch_joint": (-0.8727, 0.5236, 50, 37),
    "right_ankle_roll_joint": (-0.2618, 0.2618, 50, 37),
    "waist_yaw_joint": (-2.618, 2.618, 88, 32),
    "waist_roll_joint": (-0.52, 0.52, 50, 37),
    "waist_pitch_joint": (-0.52, 0.52, 50, 37),
    "left_shoulder_pitch_joint": (-3.0892, 2.6704, 25, 37),
    "left_shoulder_roll_joint": (-1.5882, 2.2515, 25, 37),
    "left_shoulder_yaw_joint": (-2.618, 2.618, 25, 37),
    "left_elbow_joint": (-1.0472, 2.0944, 25, 37),
    "right_shoulder_pitch_joint": (-3.0892, 2.6704, 25, 37),
    "right_shoulder_roll_joint": (-2.2515, 1.5882, 25, 37),
    "right_shoulder_yaw_joint": (-2.618, 2.618, 25, 37),
    "right_elbow_joint": (-1.0472, 2.0944, 25, 37),
}
# joint: default pose (rad), kp (N m/rad), kd (N m s/rad)
ASAP = {
    "left_hip_pitch_joint": (-0.1, 100, 2.5),
    "left_hip_roll_joint": (0, 100, 2.5),
    "left_hip_yaw_joint": (0, 100, 2.5),
    "left_knee_joint": (0.3, 200, 5),
    "left_ankle_pitch_joint": (-0.2, 20, 0.2),
    "left_ankle_roll_joint": (0, 20, 0.1),
    "right_hip_pitch_joint": (-0.1, 100, 2.5),
    "right_hip_roll_joint": (0, 100, 2.5),
    "right_hip_yaw_joint": (0, 100, 2.5),
    "right_knee_joint": (0.3, 200, 5),
    "right_ankle_pitch_joint": (-0.2, 20, 0.2),
    "right_ankle_roll_joint": (0, 20, 0.1),
    "waist_yaw_joint": (0, 400, 5),
    "waist_roll_joint": (0, 400, 5),
    "waist_pitch_joint": (0, 400, 5),
    "left_shoulder_pitch_joint": (0, 90, 2),
    "left_shoulder_roll_joint": (0, 60, 1),
    "left_shoulder_yaw_joint": (0, 20, 0.4),
    "left_elbow_joint": (0, 60, 1),
    "right_shoulder_pitch_joint": (0, 90, 2),
    "right_shoulder_roll_joint": (0, 60, 1),
    "right_shoulder_yaw_joint": (0, 20, 0.4),
    "right_elbow_joint": (0, 60, 1),
}
# joint: default pose (rad), kp, kd, armature (kg m^2), action scale (rad)
BEYONDMIMIC = {
    "left_hip_pitch_joint": (-0.312, 40.18, 2.558, 0.010178, 0.5475),
    "left_hip_roll_joint": (0, 99.10, 6.309, 0.025102, 0.3507),
    "left_hip_yaw_joint": (0, 40.18, 2.558, 0.010178, 0.5475),
    "left_knee_joint": (0.669, 99.10, 6.309, 0.025102, 0.3507),
    "left_ankle_pitch_joint": (-0.363, 28.50, 1.814, 0.007219, 0.4386),
    "left_ankle_roll_joint": (0, 28.50, 1.814, 0.007219, 0.4386),
    "right_hip_pitch_joint": (-0.312, 40.18, 2.558, 0.010178, 0.5475),
    "right_hip_roll_joint": (0, 99.10, 6.309, 0.025102, 0.3507),
    "right_hip_yaw_joint": (0, 40.18, 2.558, 0.010178, 0.5475),
    "right_knee_joint": (0.669, 99.10, 6.309, 0.025102, 0.3507),
    "right_ankle_pitch_joint": (-0.363, 28.50, 1.814, 0.007219, 0.4386),
    "right_ankle_roll_joint": (0, 28.50, 1.814, 0.007219, 0.4386),
    "waist_yaw_joint": (0, 40.18, 2.558, 0.010178, 0.5475),
    "waist_roll_joint": (0, 28.50, 1.814, 0.007219, 0.4386),
    "waist_pitch_joint": (0, 28.50, 1.814, 0.007219, 0.4386),
    "left_shoulder_pitch_joint": (0.2, 14.25, 0.907, 0.003610, 0.4386),
    "left_shoulder_roll_joint": (0.2, 14.25, 0.907, 0.003610, 0.4386),
    "left_shoulder_yaw_joint": (0, 14.25, 0.907, 0.003610, 0.4386),
    "left_elbow_joint": (0.6, 14.25, 0.907, 0.003610, 0.4386),
    "right_shoulder_pitch_joint": (0.2, 14.25, 0.907, 0.003610, 0.4386),
    "right_shoulder_roll_joint": (-0.2, 14.25, 0.907, 0.003610, 0.4386),
    "right_shoulder_yaw_joint": (0, 14.25, 0.907, 0.003610, 0.4386),
    "right_elbow_joint": (0.6, 14.25, 0.907, 0.003610, 0.4386),
}


def _columns(*names: str, gains: str) -> np.ndarray:
    tables = G1.joint_tables(gains)
    return np.column_stack([tables[name] for name in names])


def test_joint_order_is_that_of_the_table() -> None:
    assert tuple(LIMITS) == G1.joint_names
    assert tuple(ASAP) == G1.joint_names
    assert tuple(BEYONDMIMIC) == G1.joint_names
    assert G1.num_joints == 23


@pytest.mark.parametrize("gains", G1.gain_sets)
def test_ranges_efforts_and_speeds(gains: str) -> None:
    found = _columns("joint_range_rad", "effort_limit_nm", "velocity_limit_rad_s", gains=gains)
    np.testing.assert_array_equal(found, list(LIMITS.values()))


def test_asap_gains() -> None:
    found = _columns("default_joint_pos_rad", "kp", "kd", gains="asap")
    np.testing.assert_array_equal(found, list(ASAP.values()))
    np.testing.assert_array_equal(
        _columns("armature", "action_scale_rad", gains="asap"), [(0.001, 0.25)] * 23
    )


def test_beyondmimic_gains() -> None:
    names = ("default_joint_pos_rad", "kp", "kd", "armature", "action_scale_rad")
    found = _columns(*names, gains="beyondmimic")
    np.testing.assert_array_equal(found, list(BEYONDMIMIC.values()))


def test_beyondmimic_gains_follow_from_the_armature() -> None:
    """kp = armature (2 pi 10 Hz)^2, kd = 2 . 2 . armature . 2 pi 10 Hz, scale = effort / 4 kp.

    As far as three printed digits go.
    """
    tables = G1.joint_tables("beyondmimic")
    rate = 2 * math.pi * 10
    np.testing.assert_allclose(tables["kp"], tables["armature"] * rate**2, rtol=6e-4)
    np.testing.assert_allclose(tables["kd"], 4 * tables["armature"] * rate, rtol=6e-4)
    scale = tables["effort_limit_nm"] / (4 * tables["kp"])
    np.testing.assert_allclose(tables["action_scale_rad"], scale, rtol=6e-4)


@pytest.mark.parametrize("gains", G1.gain_sets)
def test_default_pose_lies_inside_the_ranges(gains: str) -> None:
    tables = G1.joint_tables(gains)
    low, high = tables["joint_range_rad"].T
    assert (low < tables["default_joint_pos_rad"]).all()
    assert (tables["default_joint_pos_rad"] < high).all()


def test_tracked_bodies_are_24_links_and_three_points() -> None:
    assert len(G1.link_names) == 24
    assert (*G1.link_names, "left_hand", "right_hand", "head") == G1.tracked_bodies
    # A link hangs on each joint; the pelvis hangs on none, the torso on the last waist joint.
    links = {name.removesuffix("_joint") + "_link" for name in G1.joint_names}
    links = links - {"waist_pitch_link"} | {"pelvis", "torso_link"}
    assert set(G1.link_names) == links


def test_upper_body_is_arms_hands_and_head_and_lower_body_the_rest() -> None:
    upper = {G1.tracked_bodies[i] for i in G1.upper_body}
    arm = ("shoulder_pitch_link", "shoulder_roll_link", "shoulder_yaw_link", "elbow_link", "hand")
    assert upper == {f"{side}_{part}" for side in ("left", "right") for part in arm} | {"head"}
    assert len(G1.upper_body) == 11
    assert len(G1.lower_body) == 16
    assert sorted(G1.upper_body + G1.lower_body) == list(range(27))


def test_named_points() -> None:
    def names(indices: tuple[int, ...]) -> list[str]:
        return [G1.tracked_bodies[i] for i in indices]

    assert names(G1.three_points) == ["left_hand", "right_hand", "head"]
    assert names(G1.feet) == ["left_ankle_roll_link", "right_ankle_roll_link"]
    assert G1.tracked_bodies[G1.pelvis] == "pelvis"


def test_fifty_control_steps_of_four_physics_steps_make_a_second() -> None:
    assert SIM_DT_S == 0.005
    assert DECIMATION == 4
    assert math.isclose(50 * CONTROL_DT_S, 1.0)
