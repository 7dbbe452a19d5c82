"""LocoMuJoCo before 1.0: its first model of the G1, carried over to today's."""

import numpy as np
import pytest
from foreign_files import LEG, npz
from scipy.spatial.transform import Rotation

from tlr_exp.motion.importers.convert import import_motion
from tlr_exp.motion.importers.raw import MotionFileError, Options
from tlr_exp.robot.g1 import G1

# Where the first model of the G1 (2024) has the frames of its leg, from its parent's: place (m)
# and turn about y (degrees); hip pitch, hip roll, hip yaw, knee, ankle pitch, ankle roll.
OLD_LEG = (
    ((0.0, 0.06445, -0.1027), -20.0, "y"),
    ((0.0, 0.0523, 0.0), 0.0, "x"),
    ((0.01966, -0.0012139, -0.1241), 0.0, "z"),
    ((-0.078292, -0.0017335, -0.177225), 29.198, "y"),
    ((0.0, 0.0040687, -0.30007), -9.198, "y"),
    ((0.0, 0.0, -0.017558), 0.0, "x"),
)


def old_foot(angles: np.ndarray) -> tuple[np.ndarray, Rotation]:
    """Place and orientation of the old model's left foot in the frame of its pelvis."""
    place, turn = np.zeros(3), Rotation.identity()
    for (offset, tilt, axis), angle in zip(OLD_LEG, angles, strict=True):
        place = place + turn.apply(offset)
        turn = turn * Rotation.from_euler("y", tilt, degrees=True)
        turn = turn * Rotation.from_euler(axis, angle)
    return place, turn


def old_locomujoco_arrays() -> dict:
    """A squat of the first G1: 41 frames, the root by six joints, heights from the pelvis'."""
    bend = 0.3 + 0.2 * np.sin(np.arange(41) / 10)
    zero = np.zeros(41)
    root = dict.fromkeys(("tx", "ty", "tz", "tilt", "list", "rotation"), zero)
    root |= {"tx": np.arange(41) * 0.01, "tilt": zero - 0.1, "rotation": zero + 0.5}
    leg = {"hip_pitch": -bend, "knee": 2 * bend - 0.2, "ankle_pitch": -bend + 0.3}
    leg |= {"hip_roll": zero + 0.05, "hip_yaw": zero, "ankle_roll": zero - 0.05}
    arm = ("shoulder_pitch", "shoulder_roll", "shoulder_yaw", "elbow_pitch", "elbow_roll")
    joints = {"torso_joint": zero + 0.2}
    for side in ("left", "right"):
        sign = 1 if side == "left" else -1
        joints |= {
            f"{side}_{name}_joint": angle * (sign if "roll" in name else 1)
            for name, angle in leg.items()
        }
        joints |= {f"{side}_{name}_joint": zero for name in arm}
    positions = {f"pelvis_{name}": value for name, value in root.items()} | joints
    return {f"{k}_{n}": v for k in ("q", "dq") for n, v in positions.items()}


def test_locomujoco_before_its_first_version(written, robot):
    """The feet point as they do on the model that the file was made for, and are as high."""
    arrays = old_locomujoco_arrays()
    path = written(npz(**arrays, split_points=np.array([0, 41])))
    with pytest.raises(MotionFileError, match=r"give --fps \(LocoMuJoCo's recordings.*500"):
        import_motion(path, robot)
    imported = import_motion(path, robot, options=Options(fps=50.0))
    clip = imported.clip
    assert imported.format == "locomujoco-0"
    # About -y by the tilt, then about the new z by the rotation.
    pelvis = Rotation.from_euler("YZ", [0.1, 0.5])
    np.testing.assert_allclose(
        Rotation.from_quat(clip.qpos[:, [4, 5, 6, 3]]).as_matrix(),
        np.tile(pelvis.as_matrix(), (41, 1, 1)),
        atol=1e-9,
    )
    foot = G1.tracked_bodies.index("left_ankle_roll_link")
    for t in (0, 20, 40):
        angles = [arrays[f"q_left_{name}_joint"][t] for name in LEG]
        place, turn = old_foot(np.array(angles))
        ours = Rotation.from_quat(clip.body_quat_w[t, foot][[1, 2, 3, 0]])
        assert (ours.inv() * pelvis * turn).magnitude() < 1e-3
        world = np.array([arrays["q_pelvis_tx"][t], 0.0, 0.755]) + pelvis.apply(place)
        np.testing.assert_allclose(clip.body_pos_w[t, foot], world, atol=0.02)
    waist = [f"waist_{name}_joint" for name in ("yaw", "roll", "pitch")]
    columns = [7 + G1.joint_names.index(name) for name in waist]
    np.testing.assert_allclose(clip.qpos[:, columns], np.tile([0.2, 0, 0], (41, 1)), atol=1e-9)


def test_locomujoco_of_another_robot(written, robot):
    arrays = {k: v for k, v in old_locomujoco_arrays().items() if "pelvis" in k}
    arrays |= {"q_hip_flexion_r": np.zeros(41), "q_knee_angle_r": np.zeros(41)}
    with pytest.raises(MotionFileError, match="not those of the G1"):
        import_motion(written(npz(**arrays)), robot, options=Options(fps=50.0))
