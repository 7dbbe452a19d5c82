"""Finds what is physically wrong with a clip, measure by measure."""

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import uniform_filter1d

from tlr_exp.motion.checks import QPOS_JOINTS, ROOT_QUAT
from tlr_exp.motion.clip import MotionClip
from tlr_exp.motion.joint_limits import beyond_limits
from tlr_exp.motion.quality.floor import FloorContacts, floor_contacts, steady_contact, stretches
from tlr_exp.motion.quality.jumps import accelerations
from tlr_exp.motion.quality.limits import LIMITS
from tlr_exp.motion.quaternions import angle_between, rotate
from tlr_exp.robot.model import Robot

# Sliding is averaged over this time; a touch of less than half of it is no stance.
SLIDE_S = 0.2
VERDICTS = ("ok", "note", "warn", "fail")  # the later, the worse


@dataclass(frozen=True)
class Finding:
    """One measure of a clip: its worst value and where that is.

    ``frames`` is the number of frames beyond ``ok``, the limit up to which a value is right;
    ``time_s`` and ``place`` (a joint or bodies) are None where they make no sense.
    """

    measure: str
    value: float
    unit: str
    verdict: str
    ok: float | None = None
    fail: float | None = None
    frames: int = 0
    time_s: float | None = None
    place: str | None = None
    remark: str | None = None


def check_clip(clip: MotionClip, robot: Robot) -> list[Finding]:
    """All findings of a clip, in a fixed order; see docs/motions.md for what they mean.

    Raises:
        ValueError: the model has no shapes that can be measured against the floor.
    """
    floor = floor_contacts(clip, robot)
    return [
        *_floor_findings(clip, robot, floor),
        _sliding(clip, floor),
        *_joint_findings(clip, robot),
        *_jump_findings(clip),
        _self_contact(clip, robot, floor),
        _tilt(clip),
        _length(clip),
        _ends(clip),
    ]


def worst_verdict(findings: list[Finding]) -> str:
    """The worst of the findings' verdicts."""
    return max((finding.verdict for finding in findings), key=VERDICTS.index)


def _finding(
    measure: str,
    values: np.ndarray,
    fps: float,
    first_frame: int = 0,
    place: str | None = None,
    remark: str | None = None,
) -> Finding:
    """The largest of ``values`` [T] against the limit of ``measure``; NaN is no value."""
    limit, known = LIMITS[measure], np.nan_to_num(values, nan=-np.inf)
    worst = int(known.argmax()) if len(known) else 0
    # Below zero is a distance from what is wrong.
    value = max(0.0, float(known[worst])) if len(known) else 0.0
    return Finding(
        measure,
        value,
        limit.unit,
        limit.verdict(value),
        limit.ok,
        limit.fail if np.isfinite(limit.fail) else None,
        frames=int((known > limit.ok).sum()),
        time_s=(worst + first_frame) / fps,
        place=place,
        remark=remark,
    )


def _floor_findings(clip: MotionClip, robot: Robot, floor: FloorContacts) -> list[Finding]:
    def body(frame: int) -> str:
        return robot.model.body(floor.lowest_body[frame]).name

    deepest = int(floor.lowest.argmin())
    carried = floor.level[~floor.flight]
    highest = int(np.nan_to_num(floor.level, nan=-np.inf).argmax())
    remarks = []
    if floor.flight.any():
        remarks.append(f"{floor.flight.sum() / clip.fps:.2f} s of free flight not counted")
    if len(carried) and 1000 * carried.max() > LIMITS["floating"].ok:
        remarks.append(f"median {1000 * max(0.0, np.median(carried)):.0f} mm")
    return [
        _finding("in the floor", -1000 * floor.lowest, clip.fps, place=body(deepest)),
        _finding(
            "floating",
            1000 * floor.level,
            clip.fps,
            place=body(highest),
            remark=", ".join(remarks) or None,
        ),
    ]


def _sliding(clip: MotionClip, floor: FloorContacts) -> Finding:
    """The fastest foot while it stands, on average over ``SLIDE_S``."""
    window = max(1, round(SLIDE_S * clip.fps))
    speed, way = np.full((2, clip.num_frames), np.nan), {}
    for side in range(2):
        for start, end in stretches(steady_contact(floor.contact[side], clip.fps)):
            if end - start < min(window / 2, clip.num_frames):
                continue
            stance = floor.foot_speed[side, start:end]
            size = min(window, len(stance))
            speed[side, start:end] = uniform_filter1d(stance, size, mode="nearest")
            way[side, start] = (stance.sum() / clip.fps, (end - start) / clip.fps)
    if not way:
        return _finding("foot sliding", np.zeros(1), clip.fps, remark="no foot stands anywhere")
    side, frame = np.unravel_index(np.nanargmax(speed), speed.shape)
    start = max(first for of, first in way if of == side and first <= frame)
    distance, duration = way[int(side), start]
    remark = f"slides {1000 * distance:.0f} mm in {duration:.2f} s"
    worst = np.fmax(*speed)
    return _finding("foot sliding", worst, clip.fps, 0, clip.spec.foot_names[side], remark)


def _joint_findings(clip: MotionClip, robot: Robot) -> list[Finding]:
    joints = clip.qpos[:, QPOS_JOINTS]
    beyond = beyond_limits(joints, robot.joint_range_rad)
    # Between two frames, not at them: central differences would halve the speed of a spike.
    speed = 100 * clip.fps * np.abs(np.diff(joints, axis=0)) / robot.velocity_limit_rad_s
    findings = []
    for measure, values in (("beyond joint limit", beyond), ("joint speed", speed)):
        worst = int(values.max(axis=0).argmax())
        remark = None
        if values.max() < 0:
            remark = f"{-values.max():.3f} rad inside"
        found = _finding(
            measure, values.max(axis=1), clip.fps, 0, clip.spec.joint_names[worst], remark
        )
        findings.append(found)
    return findings


def _jump_findings(clip: MotionClip) -> list[Finding]:
    root, rotation, joints = accelerations(clip.qpos, clip.fps)
    if not len(joints):
        return []
    joint = clip.spec.joint_names[int(joints.max(axis=0).argmax())]
    return [
        _finding("joint jump", joints.max(axis=1), clip.fps, 1, joint),
        _finding("root jump", root, clip.fps, 1),
        _finding("root rotation jump", rotation, clip.fps, 1),
    ]


def _self_contact(clip: MotionClip, robot: Robot, floor: FloorContacts) -> Finding:
    worst = int(floor.self_depth.argmax())
    place = None
    if floor.self_depth[worst] > 0:
        place = " and ".join(robot.model.body(i).name for i in floor.self_bodies[worst])
    return _finding("links in each other", 1000 * floor.self_depth, clip.fps, place=place)


def _tilt(clip: MotionClip) -> Finding:
    """The horizontal part of gravity in the pelvis, |x| or |y|, as the environment measures it."""
    inverse = clip.qpos[:, ROOT_QUAT] * [1, -1, -1, -1]
    gravity = rotate(inverse, np.array([0.0, 0.0, -1.0]))
    remark = "the default termination ends episodes beyond 0.8"
    found = _finding(
        "tilt", np.abs(gravity[:, :2]).max(axis=1), clip.fps, place=clip.spec.pelvis_name
    )
    return found if found.verdict == "ok" else Finding(**{**vars(found), "remark": remark})


def _length(clip: MotionClip) -> Finding:
    limit = LIMITS["length"]
    verdict = limit.verdict(clip.duration_s)
    return Finding("length", clip.duration_s, limit.unit, verdict, limit.ok, limit.fail)


def _ends(clip: MotionClip) -> Finding:
    """How far the last pose is from the first: nothing wrong, but it matters for repeating it."""
    first, last = clip.qpos[0], clip.qpos[-1]
    gap = np.abs(last[QPOS_JOINTS] - first[QPOS_JOINTS])
    turn = np.degrees(angle_between(first[ROOT_QUAT], last[ROOT_QUAT]))
    way = np.linalg.norm(last[:3] - first[:3])
    return Finding(
        "end and start apart",
        float(gap.max()),
        "rad",
        "note",
        place=clip.spec.joint_names[int(gap.argmax())],
        remark=f"pelvis {way:.2f} m, {float(turn):.0f}°",
    )
