"""Repairs what can be repaired honestly: ends, joint limits, jumps, the height over the floor.

A repair takes configurations [T, 30] and gives them back with a list of what it changed, in words.
Velocities and bodies are computed anew from the result. What would have to be invented (where a
sliding foot should have stood, how a clip that is too fast would look slower) is left as it is.
"""

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import gaussian_filter1d

from tlr_exp.errors import UserError
from tlr_exp.motion.checks import QPOS_JOINTS
from tlr_exp.motion.clip import MotionClip, clip_from_qpos
from tlr_exp.motion.joint_limits import beyond_limits, clamp_joints
from tlr_exp.motion.quality.floor import CONTACT_M, floor_contacts
from tlr_exp.motion.quality.jumps import accelerations
from tlr_exp.motion.quality.limits import LIMITS
from tlr_exp.motion.quality.smoothing import SHAKING_SHARE, mend_jumps
from tlr_exp.robot.model import Robot

GROUNDS = ("constant", "varying", "none")
# A jump this close to an end is cut off with the end; one further inside is smoothed.
END_S = 0.2
# A change of height that is smaller than this is not worth a change.
MIN_SHIFT_M = 0.001
# How slowly the height may vary, where it may: the standard deviation of a Gaussian window.
VARYING_S = 0.1


@dataclass(frozen=True, eq=False)
class Repaired:
    """A repaired clip, and in words what was changed; no changes: the clip is as it was."""

    clip: MotionClip
    changes: list[str]


def repair_clip(clip: MotionClip, robot: Robot, ground: str = "constant") -> Repaired:
    """Cut off bad ends, set joints to their limits, smooth jumps, put the clip on the floor.

    Args:
        clip: is left as it is.
        robot: gives the model and the joint limits.
        ground: ``constant`` moves the whole clip up or down so that its lowest point is on the
            floor; ``varying`` first takes out what drifts slowly; ``none`` keeps the height.

    Raises:
        ValueError: an unknown ``ground``.
    """
    if ground not in GROUNDS:
        raise UserError(f"unknown ground {ground!r}; allowed are {', '.join(GROUNDS)}")
    qpos, changes = cut_ends(clip.qpos, clip.fps)
    for step in (lambda q: clamp(q, robot), lambda q: mend_jumps(q, clip.fps, clip.spec)):
        qpos, said = step(qpos)
        changes += said
    if ground != "none":
        qpos, said = to_floor(qpos, clip.fps, robot, varying=ground == "varying")
        changes += said
    return Repaired(clip_from_qpos(qpos, clip.fps, robot) if changes else clip, changes)


def cut_ends(qpos: np.ndarray, fps: float) -> tuple[np.ndarray, list[str]]:
    """Cut off the ends of [T, 30] that a jump sets apart."""
    root, rotation, joints = accelerations(qpos, fps)
    jumps = np.flatnonzero(
        (root > LIMITS["root jump"].fail)
        | (rotation > LIMITS["root rotation jump"].fail)
        | (joints.max(axis=1, initial=0.0) > LIMITS["joint jump"].fail)
    )
    frames, reach = len(qpos), round(END_S * fps)
    if len(jumps) > SHAKING_SHARE * frames:
        return qpos, []
    # Row i of the accelerations belongs to frame i + 1, and is wrong if i, i + 1 or i + 2 is.
    first = max((int(i) + 2 for i in jumps if i + 1 <= reach), default=0)
    last = min((int(i) for i in jumps if i + 1 >= frames - 1 - reach), default=frames - 1)
    if last - first + 1 < max(2, frames - 2 * (reach + 2)):
        return qpos, []  # a clip of almost nothing but ends
    changes = []
    if first:
        changes.append(f"cut off the first {first} frames ({first / fps:.2f} s), up to a jump")
    if last < frames - 1:
        cut = frames - 1 - last
        changes.append(f"cut off the last {cut} frames ({cut / fps:.2f} s), from a jump on")
    return qpos[first : last + 1].copy(), changes


def clamp(qpos: np.ndarray, robot: Robot) -> tuple[np.ndarray, list[str]]:
    """Set joints of [T, 30] that are beyond a limit to the limit."""
    beyond = beyond_limits(qpos[:, QPOS_JOINTS], robot.joint_range_rad)
    changes = [
        f"set {name} to its limit in {int((beyond[:, i] > 0).sum())} frames "
        f"(it was up to {beyond[:, i].max():.3f} rad beyond)"
        for i, name in enumerate(robot.spec.joint_names)
        if beyond[:, i].max() > LIMITS["beyond joint limit"].ok
    ]
    return (clamp_joints(qpos, robot.joint_range_rad), changes) if changes else (qpos, [])


def to_floor(
    qpos: np.ndarray, fps: float, robot: Robot, varying: bool
) -> tuple[np.ndarray, list[str]]:
    """Move [T, 30] up or down until its lowest point is on the floor."""
    qpos, changes = qpos.copy(), []
    floor = floor_contacts(clip_from_qpos(qpos, fps, robot), robot)
    if varying and np.ptp(floor.ground) > CONTACT_M:
        drift = gaussian_filter1d(floor.ground, VARYING_S * fps, mode="nearest")
        qpos[:, 2] -= drift
        changes.append(
            f"moved by {_mm(-drift.max())} to {_mm(-drift.min())} mm, slowly varying, because the "
            "clip's own floor drifts"
        )
        floor = floor_contacts(clip_from_qpos(qpos, fps, robot), robot)
    shift = -float(floor.lowest.min())
    if abs(shift) >= MIN_SHIFT_M:
        qpos[:, 2] += shift
        frame = int(floor.lowest.argmin())
        changes.append(
            f"moved the whole clip by {_mm(shift)} mm, so that its lowest point "
            f"({robot.model.body(floor.lowest_body[frame]).name} at {frame / fps:.2f} s) is on the "
            "floor"
        )
    return qpos, changes


def _mm(metres: float) -> str:
    return f"{1000 * metres:+.1f}"
