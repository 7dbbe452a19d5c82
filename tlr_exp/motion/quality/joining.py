"""Clips one after the other: each goes on where the one before it ends.

Every further clip is turned about the vertical and moved over the floor, so that its first frame
takes the place of the last one before it. What then still differs (height, tilt, joints, all
velocities) is added to the new clip and fades away within the blend. So two halves of one motion
give it back, and neither positions nor velocities jump.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import BPoly
from scipy.spatial.transform import Rotation

from tlr_exp.errors import UserError
from tlr_exp.motion.checks import QPOS_JOINTS, ROOT_QUAT
from tlr_exp.motion.clip import MotionClip, clip_from_qpos, resample
from tlr_exp.motion.joint_limits import beyond_limits, clamp_joints
from tlr_exp.motion.quaternions import heading
from tlr_exp.robot.model import Robot

BLEND_S = 0.5


@dataclass(frozen=True)
class Seam:
    """Where two clips were joined and what the blend had to make up for.

    ``clamped_rad``: by how much joints were beyond their limits during the blend, and were set to
    them.
    """

    time_s: float
    turned_rad: float
    moved_m: tuple[float, float]
    height_gap_m: float
    tilt_gap_rad: float
    joint_gap_rad: float
    joint: str
    clamped_rad: float


def join_clips(
    clips: Sequence[MotionClip], robot: Robot, blend_s: float = BLEND_S
) -> tuple[MotionClip, list[Seam]]:
    """Join clips in their order, at the rate of the first (others are resampled to it).

    Args:
        clips: at least two.
        robot: gives the model.
        blend_s: how long the differences at a seam take to fade; 0 leaves them.

    Raises:
        ValueError: fewer than two clips, or one (but the first) that is shorter than the blend.
    """
    if len(clips) < 2:
        raise UserError("joining needs at least two clips")
    if not 0 <= blend_s < np.inf:
        raise UserError(f"the blend is {blend_s:g} s; it must not be negative")
    fps, qpos, seams = clips[0].fps, clips[0].qpos, []
    velocity = clips[0].qvel[-1]
    for number, clip in enumerate(clips[1:], start=2):
        clip = resample(clip, fps, robot)
        if clip.duration_s < blend_s:
            raise UserError(
                f"clip {number} lasts {clip.duration_s:.2f} s, which is shorter than the blend of "
                f"{blend_s:g} s; give a shorter --blend"
            )
        placed, turn = _place(clip.qpos, qpos[-1])
        blended = _fade(placed, _turned(clip.qvel[0], turn), qpos[-1], velocity, fps, blend_s)
        beyond = float(beyond_limits(blended[:, QPOS_JOINTS], robot.joint_range_rad).max())
        blended = clamp_joints(blended, robot.joint_range_rad)
        end_s = (len(qpos) - 1) / fps
        seams.append(_seam(clip, placed[0], qpos[-1], turn, end_s, beyond))
        qpos, velocity = np.concatenate([qpos[:-1], blended]), clip.qvel[-1]
        velocity = _turned(velocity, turn)
    return clip_from_qpos(qpos, fps, robot), seams


def _place(qpos: np.ndarray, target: np.ndarray) -> tuple[np.ndarray, float]:
    """Turn and move [T, 30] so that its first frame has the heading and place of ``target``."""
    turn = heading(target[ROOT_QUAT]) - heading(qpos[0, ROOT_QUAT])
    spin = Rotation.from_rotvec([0.0, 0.0, turn])
    placed = qpos.copy()
    placed[:, :2] -= qpos[0, :2]
    placed[:, :3] = spin.apply(placed[:, :3])
    placed[:, :2] += target[:2]
    placed[:, ROOT_QUAT] = _quat(spin * _rotation(qpos[:, ROOT_QUAT]))
    return placed, turn


def _turned(qvel: np.ndarray, turn: float) -> np.ndarray:
    """Velocities [29] of a robot turned about the vertical: only the root's linear ones change."""
    turned = qvel.copy()
    turned[:3] = Rotation.from_rotvec([0.0, 0.0, turn]).apply(turned[:3])
    return turned


def _fade(
    qpos: np.ndarray,
    qvel: np.ndarray,
    target: np.ndarray,
    target_qvel: np.ndarray,
    fps: float,
    blend_s: float,
) -> np.ndarray:
    """[T, 30] that starts with the pose and velocity of the target and becomes ``qpos``.

    The difference fades as a quintic from its value and slope to rest (Bollo 2018,
    "Inertialization: High-Performance Animation Transitions in Gears of War").
    """
    if blend_s == 0:
        return qpos.copy()
    time = np.arange(len(qpos)) / fps
    faded = qpos.copy()
    straight = [0, 1, 2, *range(7, qpos.shape[1])]
    moving = [0, 1, 2, *range(6, len(qvel))]
    gap, slope = target[straight] - qpos[0, straight], target_qvel[moving] - qvel[moving]
    faded[:, straight] += _quintic(gap, slope, time, blend_s)
    start, end = _rotation(qpos[0, ROOT_QUAT]), _rotation(target[ROOT_QUAT])
    turn = (start.inv() * end).as_rotvec()
    # The slope of the turn between the two, from where both will be one frame later.
    ahead = start * Rotation.from_rotvec(qvel[3:6] / fps)
    ahead_target = end * Rotation.from_rotvec(target_qvel[3:6] / fps)
    slope = ((ahead.inv() * ahead_target).as_rotvec() - turn) * fps
    turns = Rotation.from_rotvec(_quintic(turn, slope, time, blend_s))
    faded[:, ROOT_QUAT] = _quat(_rotation(qpos[:, ROOT_QUAT]) * turns)
    return faded


def _quintic(value: np.ndarray, slope: np.ndarray, time: np.ndarray, end_s: float) -> np.ndarray:
    """[T, n] from value and slope [n], without acceleration, to rest at 0 after ``end_s``."""
    start = np.stack([value, slope, np.zeros_like(value)])
    curve = BPoly.from_derivatives([0.0, end_s], np.stack([start, np.zeros_like(start)]))
    return np.where(time[:, None] < end_s, curve(np.minimum(time, end_s)), 0.0)


def _seam(
    clip: MotionClip,
    placed: np.ndarray,
    target: np.ndarray,
    turn: float,
    time_s: float,
    beyond: float,
) -> Seam:
    gap = np.abs(target[QPOS_JOINTS] - placed[QPOS_JOINTS])
    tilt = (_rotation(placed[ROOT_QUAT]).inv() * _rotation(target[ROOT_QUAT])).magnitude()
    moved = placed[:2] - clip.qpos[0, :2]
    return Seam(
        time_s=time_s,
        turned_rad=float((turn + np.pi) % (2 * np.pi) - np.pi),
        moved_m=(float(moved[0]), float(moved[1])),
        height_gap_m=float(target[2] - placed[2]),
        tilt_gap_rad=float(tilt),
        joint_gap_rad=float(gap.max()),
        joint=clip.spec.joint_names[int(gap.argmax())],
        clamped_rad=max(0.0, beyond),
    )


def _rotation(quats: np.ndarray) -> Rotation:
    return Rotation.from_quat(np.array(quats), scalar_first=True)  # read-only ones are refused


def _quat(rotation: Rotation) -> np.ndarray:
    return rotation.as_quat(scalar_first=True)
