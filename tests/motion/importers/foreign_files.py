"""A file of every format, written by the tests themselves from one motion of the 29-joint robot."""

import io
import pickle
from collections.abc import Callable

import joblib
import numpy as np
from scipy.spatial.transform import Rotation

from tlr_exp.motion.clip import MotionClip
from tlr_exp.robot.g1 import G1

# Written out, so that the order does not come from the code under test.
LEG = ("hip_pitch", "hip_roll", "hip_yaw", "knee", "ankle_pitch", "ankle_roll")
ARM = ("shoulder_pitch", "shoulder_roll", "shoulder_yaw", "elbow")
WRIST = ("wrist_roll", "wrist_pitch", "wrist_yaw")
WAIST = ("waist_yaw", "waist_roll", "waist_pitch")
MUJOCO_ORDER = [
    f"{name}_joint"
    for name in (
        *(f"left_{part}" for part in LEG),
        *(f"right_{part}" for part in LEG),
        *WAIST,
        *(f"left_{part}" for part in (*ARM, *WRIST)),
        *(f"right_{part}" for part in (*ARM, *WRIST)),
    )
]
ISAAC_ORDER = (
    "left_hip_pitch right_hip_pitch waist_yaw left_hip_roll right_hip_roll waist_roll "
    "left_hip_yaw right_hip_yaw waist_pitch left_knee right_knee left_shoulder_pitch "
    "right_shoulder_pitch left_ankle_pitch right_ankle_pitch left_shoulder_roll "
    "right_shoulder_roll left_ankle_roll right_ankle_roll left_shoulder_yaw right_shoulder_yaw "
    "left_elbow right_elbow left_wrist_roll right_wrist_roll left_wrist_pitch right_wrist_pitch "
    "left_wrist_yaw right_wrist_yaw"
)
ISAAC_ORDER = [f"{name}_joint" for name in ISAAC_ORDER.split()]
WRIST_ANGLE_RAD = 0.7


def link(joint: str) -> str:
    return {"waist_pitch_joint": "torso_link"}.get(joint, joint.replace("_joint", "_link"))


def joints_in(order: list[str], clip: MotionClip) -> np.ndarray:
    """[T, n] of the clip in that order, the wrists turned by a constant."""
    columns = [
        clip.qpos[:, 7 + G1.joint_names.index(name)]
        if name in G1.joint_names
        else np.full(clip.num_frames, WRIST_ANGLE_RAD)
        for name in order
    ]
    return np.stack(columns, axis=1)


def poses_in(order: list[str], clip: MotionClip) -> tuple[np.ndarray, np.ndarray]:
    """Positions and quaternions of the pelvis and a link per joint; those of wrists are zero."""
    names = ["pelvis", *map(link, order)]
    pos = np.zeros((clip.num_frames, len(names), 3))
    quat = np.zeros((clip.num_frames, len(names), 4))
    quat[..., 0] = 1
    for i, name in enumerate(names):
        if name in G1.link_names:
            pos[:, i] = clip.body_pos_w[:, G1.link_names.index(name)]
            quat[:, i] = clip.body_quat_w[:, G1.link_names.index(name)]
    return pos, quat


def npz(**arrays) -> bytes:
    file = io.BytesIO()
    np.savez(file, **arrays)
    return file.getvalue()


def to_joblib(content, **options) -> bytes:
    file = io.BytesIO()
    joblib.dump(content, file, **options)
    return file.getvalue()


def asap_motion(clip: MotionClip) -> dict:
    return {
        "root_trans_offset": clip.qpos[:, :3].astype(np.float32),
        "pose_aa": np.zeros((clip.num_frames, 27, 3), dtype=np.float32),
        "dof": np.asfortranarray(clip.qpos[:, 7:].astype(np.float32)),
        "root_rot": clip.qpos[:, [4, 5, 6, 3]],
        "smpl_joints": np.zeros((clip.num_frames, 24, 3), dtype=np.float32),
        "fps": 50,
    }


def asap(clip: MotionClip) -> bytes:
    return to_joblib({"0-some_motion": asap_motion(clip)})


def pbhc(clip: MotionClip) -> bytes:
    mask = np.ones((clip.num_frames, 2), dtype=np.float32)
    return to_joblib({"0-some_motion": asap_motion(clip) | {"contact_mask": mask}})


def gmr_motion(clip: MotionClip) -> dict:
    """Bodies in the frame of the pelvis, by scipy's matrices rather than our quaternions."""
    turn = Rotation.from_quat(clip.qpos[:, [4, 5, 6, 3]]).as_matrix()
    offset = clip.body_pos_w[:, : len(G1.link_names)] - clip.qpos[:, None, :3]
    return {
        "fps": 50,
        "root_pos": clip.qpos[:, :3],
        "root_rot": clip.qpos[:, [4, 5, 6, 3]],
        "dof_pos": joints_in(MUJOCO_ORDER, clip),
        "local_body_pos": np.einsum("tji,tbj->tbi", turn, offset),
        "link_body_list": list(G1.link_names),
    }


def gmr(clip: MotionClip) -> bytes:
    return pickle.dumps(gmr_motion(clip))


def lafan1(clip: MotionClip) -> bytes:
    table = np.concatenate(
        [clip.qpos[:, :3], clip.qpos[:, [4, 5, 6, 3]], joints_in(MUJOCO_ORDER, clip)], axis=1
    )
    file = io.BytesIO()
    np.savetxt(file, table, delimiter=",")
    return file.getvalue()


def tracking(order: list[str], clip: MotionClip) -> dict:
    joints = joints_in(order, clip)
    pos, quat = poses_in(order, clip)
    return {
        "fps": np.array([50]),
        "joint_pos": joints.astype(np.float32),
        "joint_vel": np.zeros_like(joints),
        "body_pos_w": pos.astype(np.float32),
        "body_quat_w": quat.astype(np.float32),
        "body_lin_vel_w": np.zeros_like(pos),
        "body_ang_vel_w": np.zeros_like(pos),
    }


def mjlab(clip: MotionClip) -> bytes:
    return npz(**tracking(MUJOCO_ORDER, clip))


def beyondmimic(clip: MotionClip) -> bytes:
    return npz(**tracking(ISAAC_ORDER, clip))


def holosoma(clip: MotionClip) -> bytes:
    arrays = tracking(MUJOCO_ORDER, clip)
    arrays["joint_pos"] = np.concatenate([clip.qpos[:, :7], arrays["joint_pos"]], axis=1)
    names = ["pelvis", *map(link, MUJOCO_ORDER)]
    return npz(**arrays, joint_names=np.array(MUJOCO_ORDER), body_names=np.array(names))


def locomujoco_arrays(clip: MotionClip) -> dict:
    """Joints in an order of its own, the free joint named first."""
    order = MUJOCO_ORDER[::-1]
    return {
        "qpos": np.concatenate([clip.qpos[:, :7], joints_in(order, clip)], axis=1),
        "qvel": np.zeros((clip.num_frames, 35)),
        "joint_names": np.array(["root", *order]),
        "body_names": np.array(["world", *G1.link_names]),
        "xpos": np.concatenate(
            [np.zeros((clip.num_frames, 1, 3)), clip.body_pos_w[:, : len(G1.link_names)]], axis=1
        ),
        "split_points": np.array([0, clip.num_frames]),
        "frequency": 50.0,
        "metadata": np.array(None, dtype=object),
    }


def locomujoco(clip: MotionClip) -> bytes:
    return npz(**locomujoco_arrays(clip))


def own(clip: MotionClip) -> bytes:
    arrays = {key: value for key, value in vars(clip).items() if key != "spec"}
    names = {"joint_names": G1.joint_names, "body_names": G1.tracked_bodies}
    return npz(**arrays, **names)


WRITERS: dict[str, Callable[[MotionClip], bytes]] = {
    "asap": asap,
    "pbhc": pbhc,
    "gmr": gmr,
    "lafan1": lafan1,
    "mjlab": mjlab,
    "beyondmimic": beyondmimic,
    "holosoma": holosoma,
    "locomujoco": locomujoco,
    "tlr": own,
}
