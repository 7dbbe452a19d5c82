"""Files of layouts that are less usual, written by the tests themselves from one motion."""

import io
from collections.abc import Sequence

import numpy as np
import torch
from foreign_files import ISAAC_ORDER, MUJOCO_ORDER, joints_in, link, npz, poses_in, tracking
from scipy.spatial.transform import Rotation

from tlr_exp.motion.clip import MotionClip
from tlr_exp.robot.g1 import G1


def text(rows: np.ndarray, separator: str = ",", names: Sequence[str] = ()) -> bytes:
    lines = [separator.join(names)] if names else []
    lines += [separator.join(f"{number:.12g}" for number in row) for row in rows]
    return ("\n".join(lines) + "\n").encode()


def lafan1_rows(clip: MotionClip, order: Sequence[str] = MUJOCO_ORDER) -> np.ndarray:
    """[T, 7 + n]: position, quaternion xyzw, joints."""
    root = [clip.qpos[:, :3], clip.qpos[:, [4, 5, 6, 3]]]
    return np.concatenate([*root, joints_in(list(order), clip)], axis=1)


def table_23(clip: MotionClip) -> bytes:
    return text(lafan1_rows(clip, G1.joint_names))


def timed(clip: MotionClip) -> bytes:
    times = np.arange(clip.num_frames) / clip.fps
    return text(np.column_stack([times.round(3), lafan1_rows(clip)]))


NAMED = ["Frame", *(f"root_translate{axis}" for axis in "XYZ")]
NAMED += [f"root_rotate{axis}" for axis in "XYZ"]


def bones_seed(clip: MotionClip) -> bytes:
    """Centimetres; degrees, also of the root's angles about fixed axes."""
    root = Rotation.from_quat(clip.qpos[:, [4, 5, 6, 3]]).as_euler("xyz", degrees=True)
    joints = np.degrees(joints_in(MUJOCO_ORDER, clip))
    frames = np.arange(clip.num_frames)
    rows = np.column_stack([frames, clip.qpos[:, :3] * 100, root, joints])
    return text(rows, names=[*NAMED, *(f"{joint}_dof" for joint in MUJOCO_ORDER)])


def with_others(arrays: dict, before: int, behind: int) -> dict:
    """Bodies that stand at the origin before the robot's, and others that lie far behind them."""
    count = len(arrays["joint_pos"])
    still, far = np.zeros((count, before, 3)), np.full((count, behind, 3), 3.0)
    quats = np.tile([1.0, 0, 0, 0], (count, before + behind, 1))
    arrays["body_pos_w"] = np.concatenate([still, arrays["body_pos_w"], far], axis=1)
    arrays["body_quat_w"] = np.concatenate(
        [quats[:, :before], arrays["body_quat_w"], quats[:, before:]], axis=1
    )
    return arrays


def unilab(clip: MotionClip) -> bytes:
    """The world before the 30 bodies."""
    return npz(**with_others(tracking(MUJOCO_ORDER, clip), 1, 0))


def hdmi(clip: MotionClip) -> bytes:
    """World and terrain before the 30 bodies, a box behind them; no rate."""
    arrays = with_others(tracking(MUJOCO_ORDER, clip), 2, 1)
    del arrays["fps"]
    return npz(**arrays)


def amp_arrays(clip: MotionClip) -> dict:
    pos, quat = poses_in(ISAAC_ORDER, clip)
    joints = joints_in(ISAAC_ORDER, clip)
    return {
        "fps": np.int64(50),
        "dof_names": np.array(ISAAC_ORDER),
        "body_names": np.array(["pelvis", *map(link, ISAAC_ORDER)]),
        "dof_positions": joints.astype(np.float32),
        "dof_velocities": np.zeros_like(joints),
        "body_positions": pos.astype(np.float32),
        "body_rotations": quat.astype(np.float32),
        "body_linear_velocities": np.zeros_like(pos),
        "body_angular_velocities": np.zeros_like(pos),
    }


def amp(clip: MotionClip) -> bytes:
    return npz(**amp_arrays(clip))


def to_torch(content: object, **options) -> bytes:
    file = io.BytesIO()
    torch.save(content, file, **options)
    return file.getvalue()


def proto_motion(clip: MotionClip) -> dict:
    """Its model has a head and hands among the bodies; quaternions xyzw."""
    pos, quat = poses_in(MUJOCO_ORDER, clip)
    other = pos[:, :1] + 0.3
    pos = np.concatenate([pos[:, :16], other, pos[:, 16:], other + 0.2], axis=1)
    quat = np.concatenate([quat[:, :16], quat[:, :1], quat[:, 16:], quat[:, :1]], axis=1)
    return {
        "fps": 50.0,
        "dof_pos": torch.tensor(joints_in(MUJOCO_ORDER, clip), dtype=torch.float32),
        "dof_vel": torch.zeros(clip.num_frames, 29),
        "rigid_body_pos": torch.tensor(pos, dtype=torch.float32),
        "rigid_body_rot": torch.tensor(np.roll(quat, -1, axis=-1), dtype=torch.float32),
        "rigid_body_contacts": torch.ones(clip.num_frames, pos.shape[1], dtype=torch.bool),
    }


def protomotions(clip: MotionClip) -> bytes:
    return to_torch(proto_motion(clip))


def proto_library(clip: MotionClip, count: int = 1) -> dict:
    motion, frames = proto_motion(clip), clip.num_frames
    names = {"gts": "rigid_body_pos", "grs": "rigid_body_rot", "dps": "dof_pos"}
    packed = {key: torch.cat([motion[name]] * count) for key, name in names.items()}
    return {
        **packed,
        "length_starts": torch.arange(count) * frames,
        "motion_num_frames": torch.full((count,), frames),
        "motion_dt": torch.full((count,), 1 / 50),
        "motion_files": tuple(f"data/walk_{number}.motion" for number in range(count)),
    }


def protomotions_library(clip: MotionClip) -> bytes:
    return to_torch(proto_library(clip))


WILD = {
    "table of 23 joints": table_23,
    "table with times": timed,
    "bones-seed": bones_seed,
    "unilab": unilab,
    "hdmi": hdmi,
    "amp": amp,
    "protomotions": protomotions,
    "protomotions-library": protomotions_library,
}
FORMATS = {
    "table of 23 joints": "lafan1",
    "table with times": "lafan1",
    "unilab": "beyondmimic",
    "hdmi": "beyondmimic",
    "mjlab": "beyondmimic",
}
# Files that do not say that they have 50 frames a second.
WITHOUT_RATE = ("lafan1", "table of 23 joints", "bones-seed", "hdmi")
