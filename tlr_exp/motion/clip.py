"""``MotionClip``: a reference motion of one robot, as arrays and as an ``.npz`` file.

Every clip is checked when it is made, wherever it comes from, so that whatever holds one may rely
on its shapes, its names, its units and its joint limits.
"""

import os
import zipfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from uuid import uuid4

import mujoco
import numpy as np
from scipy.interpolate import CubicSpline

from tlr_exp.errors import UserError
from tlr_exp.motion.checks import (
    ARRAYS,
    BODY_WIDTHS,
    QPOS_JOINTS,
    ROOT_QUAT,
    check_finite,
    check_fps,
    check_names,
    check_shapes,
    check_unit,
)
from tlr_exp.motion.joint_limits import check_limits
from tlr_exp.motion.quaternions import angle_between, continuous, normalised
from tlr_exp.robot.model import Robot
from tlr_exp.robot.spec import RobotSpec

# How far bodies may be from forward kinematics: room for float32 files and other conventions of
# rounding, none for another robot.
MAX_OFFSET_M, MAX_ANGLE_RAD = 0.01, 0.02
_KEYS = (*ARRAYS, "fps", "joint_names", "body_names")


@dataclass(frozen=True, eq=False)
class MotionClip:
    """A motion sampled at a constant rate; T frames, float64, SI units, quaternions wxyz.

    ``qpos`` and ``qvel`` follow MuJoCo: root position and orientation, then the joints; root
    linear velocity in the world frame, root angular velocity in the pelvis frame, then the joints.
    Body arrays are in the world frame and describe the origins of the robot's tracked bodies.
    Shapes are those of the G1.

    Arrays are copied and made read-only. Quaternions are normalised, and their signs chosen so
    that neighbouring frames never jump to the other of the two equal quaternions.

    Raises:
        ValueError: a wrong shape, rate or number of frames, a value that is not finite, a
            quaternion that is not a unit one, or a joint beyond its limits.
    """

    spec: RobotSpec
    fps: float
    qpos: np.ndarray  # [T, 30]
    qvel: np.ndarray  # [T, 29]
    body_pos_w: np.ndarray  # [T, 27, 3]
    body_quat_w: np.ndarray  # [T, 27, 4]
    body_lin_vel_w: np.ndarray  # [T, 27, 3]
    body_ang_vel_w: np.ndarray  # [T, 27, 3]

    def __post_init__(self) -> None:
        object.__setattr__(self, "fps", float(self.fps))
        for key in ARRAYS:
            object.__setattr__(self, key, np.array(getattr(self, key), dtype=np.float64))
        self.validate()
        self.qpos[:, ROOT_QUAT] = continuous(self.qpos[:, ROOT_QUAT])
        self.body_quat_w[:] = continuous(self.body_quat_w)
        for key in ARRAYS:
            getattr(self, key).setflags(write=False)

    @property
    def num_frames(self) -> int:
        return len(self.qpos)

    @property
    def duration_s(self) -> float:
        """Time from the first frame to the last, in seconds."""
        return (self.num_frames - 1) / self.fps

    def validate(self) -> None:
        """Check the clip; runs at construction.

        Raises:
            ValueError: see the class.
        """
        check_fps(self.fps)
        check_shapes({key: getattr(self, key) for key in ARRAYS}, self.spec)
        for key in ARRAYS:
            check_finite(key, getattr(self, key))
        check_unit("the root of qpos", self.qpos[:, ROOT_QUAT])
        check_unit("body_quat_w", self.body_quat_w)
        check_limits(self.qpos[:, QPOS_JOINTS], self.spec)

    def save(self, path: str | Path) -> None:
        """Write the clip as ``.npz``; a reader sees the old file or the whole new one.

        Raises:
            OSError: the folder cannot be written.
        """
        path = Path(path)
        arrays = {key: getattr(self, key) for key in ARRAYS}
        temporary = path.with_name(f".{path.name}.{uuid4().hex}")
        try:
            with temporary.open("wb") as file:
                np.savez_compressed(
                    file,
                    fps=np.float64(self.fps),
                    joint_names=np.array(self.spec.joint_names),
                    body_names=np.array(self.spec.tracked_bodies),
                    **arrays,
                )
            os.replace(temporary, path)
        except BaseException:
            temporary.unlink(missing_ok=True)
            raise

    @classmethod
    def load(cls, path: str | Path, spec: RobotSpec) -> "MotionClip":
        """Read a clip written by ``save``, or by anything that writes the same keys.

        Raises:
            FileNotFoundError: there is no such file.
            ValueError: the file is no clip, of another robot, or not valid; the message names it.
        """
        try:
            with Path(path).open("rb") as file, np.load(file, allow_pickle=False) as data:
                missing = [key for key in _KEYS if key not in data.files]
                if missing:
                    raise UserError(f"it lacks {', '.join(missing)}; it has {data.files}")
                joints, bodies = data["joint_names"].tolist(), data["body_names"].tolist()
                check_names(spec, tuple(joints), tuple(bodies))
                arrays: dict[str, Any] = {key: data[key] for key in ARRAYS}
                return cls(spec, fps=data["fps"].item(), **arrays)
        except FileNotFoundError:
            raise FileNotFoundError(f"there is no motion clip {path}") from None
        except (ValueError, TypeError, EOFError, OSError, zipfile.BadZipFile) as error:
            raise UserError(f"cannot read the motion clip {path}: {error}") from error


def clip_from_qpos(qpos: np.ndarray, fps: float, robot: Robot) -> MotionClip:
    """Make a clip from configurations alone; MuJoCo gives all the rest.

    Velocities are second-order differences (central inside, one-sided at the two ends), body
    poses and twists MuJoCo's forward kinematics of ``qpos`` and those velocities.

    Args:
        qpos: [T, 30], metres, wxyz, radians.
        fps: frames a second.
        robot: gives the model.

    Raises:
        ValueError: as ``MotionClip``.
    """
    qpos = np.array(qpos, dtype=np.float64)
    width = robot.spec.num_qpos
    if qpos.ndim != 2 or qpos.shape[1] != width or len(qpos) < 2:
        raise UserError(f"motion clip: qpos is {qpos.shape}; expected [T >= 2, {width}]")
    check_finite("qpos", qpos)
    check_fps(fps)
    check_unit("the root of qpos", qpos[:, ROOT_QUAT])
    qpos[:, ROOT_QUAT] = continuous(qpos[:, ROOT_QUAT])
    qvel = differentiate_qpos(robot.model, qpos, fps)
    bodies: dict[str, Any] = body_states(robot, qpos, qvel)
    return MotionClip(robot.spec, fps=fps, qpos=qpos, qvel=qvel, **bodies)


def differentiate_qpos(model: mujoco.MjModel, qpos: np.ndarray, fps: float) -> np.ndarray:
    """Velocities [T, 29] of configurations [T, 30], by differences taken at each frame.

    Both differences of a frame are taken from that frame, so that the angular velocity is
    expressed in its own pelvis frame, which is MuJoCo's convention.
    """

    def difference(start: int, end: int) -> np.ndarray:
        out = np.zeros(model.nv)
        mujoco.mj_differentiatePos(model, out, 1.0, qpos[start], qpos[end])
        return out

    last = len(qpos) - 1
    qvel = np.empty((len(qpos), model.nv))
    for t in range(1, last):
        qvel[t] = (difference(t, t + 1) - difference(t, t - 1)) / 2
    if last == 1:
        qvel[0], qvel[1] = difference(0, 1), -difference(1, 0)
    else:
        qvel[0] = (4 * difference(0, 1) - difference(0, 2)) / 2
        qvel[last] = (difference(last, last - 2) - 4 * difference(last, last - 1)) / 2
    return qvel * fps


def body_states(robot: Robot, qpos: np.ndarray, qvel: np.ndarray) -> dict[str, np.ndarray]:
    """Poses and twists of the tracked bodies, by MuJoCo's forward kinematics.

    Args:
        robot: gives the model and the bodies.
        qpos: [T, 30].
        qvel: [T, 29].

    Returns:
        body_pos_w [T, 27, 3], body_quat_w [T, 27, 4], body_lin_vel_w and body_ang_vel_w
        [T, 27, 3]: world frame, velocities of the bodies' origins.
    """
    model, data, ids = robot.model, mujoco.MjData(robot.model), robot.body_ids
    out = {key: np.empty((len(qpos), len(ids), width)) for key, width in BODY_WIDTHS.items()}
    roots = model.body_rootid[ids]
    for t in range(len(qpos)):
        data.qpos[:], data.qvel[:] = qpos[t], qvel[t]
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_comVel(model, data)
        out["body_pos_w"][t] = data.xpos[ids]
        out["body_quat_w"][t] = data.xquat[ids]
        angular, linear = data.cvel[ids, :3], data.cvel[ids, 3:]
        # MuJoCo states the linear velocity at the centre of mass of the whole tree.
        arm = data.xpos[ids] - data.subtree_com[roots]
        out["body_lin_vel_w"][t] = linear + np.cross(angular, arm)
        out["body_ang_vel_w"][t] = angular
    return out


def kinematics_error(clip: MotionClip, robot: Robot) -> tuple[float, float]:
    """Largest disagreement of a clip's body poses with forward kinematics of its ``qpos``.

    A clip made for another model (other link lengths, other hand points) shows here.

    Returns:
        Position in metres, angle in radians.
    """
    poses = body_states(robot, clip.qpos, clip.qvel)
    offset = np.linalg.norm(poses["body_pos_w"] - clip.body_pos_w, axis=-1)
    angle = angle_between(poses["body_quat_w"], clip.body_quat_w)
    return float(offset.max()), float(angle.max())


def check_consistency(clip: MotionClip, robot: Robot, name: str) -> None:
    """Refuse a clip whose bodies or velocities do not belong to its ``qpos`` and this robot.

    Raises:
        ValueError: bodies farther than 1 cm or 0.02 rad from forward kinematics, or velocities
            that differ from the derivative of ``qpos`` by more than half of it.
    """
    offset, angle = kinematics_error(clip, robot)
    if offset > MAX_OFFSET_M or angle > MAX_ANGLE_RAD:
        raise UserError(
            f"{name}: its bodies are up to {offset:.3f} m and {angle:.3f} rad from where its qpos "
            "puts them on this robot; make it anew with tlr_exp.motion.clip.clip_from_qpos"
        )
    derivative = differentiate_qpos(robot.model, clip.qpos, clip.fps)
    difference = np.linalg.norm(clip.qvel - derivative)
    if difference > 0.5 * np.linalg.norm(derivative) + 1e-6:
        raise UserError(
            f"{name}: its qvel is not the derivative of its qpos; make it anew with "
            "tlr_exp.motion.clip.clip_from_qpos"
        )


def resample(clip: MotionClip, fps: float, robot: Robot) -> MotionClip:
    """The same motion at another rate, by a cubic spline through its frames.

    Its acceleration is continuous. Straight lines between frames would gather the acceleration in
    the frames, where second differences grow by up to the ratio of the rates (5/3 from 30 to 50
    Hz); curves that never overshoot (PCHIP, Akima) flatten what turns between two frames. Where the
    spline leaves the range of a joint, and the clip does not, it is cut off. Quaternions are
    interpolated by component and normalised: within the step of a frame they hardly bend.

    Frames that fall together are the same to rounding. The last frame is the last whole step of the
    new rate within the clip. A clip that already has the rate is returned as it is.

    Raises:
        ValueError: ``fps`` is not positive, or too low to leave two frames.
    """
    check_fps(fps)
    if fps == clip.fps:
        return clip
    # A whole number of frames must not be lost to rounding.
    count = int(np.floor(clip.duration_s * fps + 1e-6)) + 1
    frame = np.minimum(np.arange(count) * clip.fps / fps, clip.num_frames - 1)
    qpos = CubicSpline(np.arange(clip.num_frames), clip.qpos)(frame)
    qpos[:, ROOT_QUAT] = normalised(qpos[:, ROOT_QUAT])
    joints, (low, high) = clip.qpos[:, QPOS_JOINTS], robot.joint_range_rad.T
    low, high = np.minimum(low, joints.min(axis=0)), np.maximum(high, joints.max(axis=0))
    qpos[:, QPOS_JOINTS] = qpos[:, QPOS_JOINTS].clip(low, high)
    return clip_from_qpos(qpos, fps, robot)
