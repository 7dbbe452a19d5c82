"""Tells a motion of a robot on a floor from a file read by the wrong conventions.

A table in centimetres, with quaternions in the other order or with another axis pointing up has
the shape of any other. So every import is measured: where the robot stands, by forward kinematics,
which way its torso points, how fast it goes. What cannot be is refused, and so is what another
reading makes far better sense of; the message names that reading and the option that takes it.
"""

from dataclasses import replace
from itertools import product as combinations

import numpy as np

from tlr_exp.motion.checks import QPOS_JOINTS, ROOT_QUAT
from tlr_exp.motion.importers.raw import (
    Conventions,
    MotionFileError,
    Options,
    RawMotion,
    Recorded,
    thinned,
)
from tlr_exp.motion.importers.readings.conventions import LARGEST_RAD, open_choices
from tlr_exp.motion.importers.readings.kinematics import with_order
from tlr_exp.motion.importers.readings.stance import FRAMES, SPEED_M_S, UPRIGHT, Stance, StanceMeter
from tlr_exp.motion.joint_limits import furthest_beyond
from tlr_exp.motion.quaternions import rotate
from tlr_exp.robot.model import Robot

# Of two readings that both stand, the one with the flatter sole is right, if it is this much so.
_FLATTER, _FLATTER_BY_RAD = 0.6, 0.015
# Bodies of a file that are further from where its joints put them, and would be nearer.
_GAP_M, _NEARER = 0.05, 0.3

_Z = np.array([0.0, 0.0, 1.0])
_WORDS = {
    "units": {"m": "metres", "cm": "centimetres", "mm": "millimetres"},
    "quaternion": {"wxyz": "quaternions written w x y z", "xyzw": "quaternions written x y z w"},
    "up": {"y": "the y axis pointing up", "z": "the z axis pointing up"},
    "angles": {"deg": "joints in degrees", "rad": "joints in radians"},
    "joint_order": {"isaac": "joints in Isaac Lab's order", "mujoco": "joints in MuJoCo's order"},
}


def check_plausible(
    recorded: Recorded, raw: RawMotion, robot: Robot, options: Options, clamp_rad: float
) -> None:
    """Refuse a motion that cannot be so, or that another reading makes far better sense of.

    Args:
        recorded: what the file holds.
        raw: as it was read.
        robot: gives the model and the joint limits.
        options: what the user says of the file is not questioned.
        clamp_rad: how far beyond its limits a joint may be.

    Raises:
        MotionFileError: what cannot be, the likely reading, and the option that takes it.
    """
    if options.anyway:
        return
    now = StanceMeter(robot).measure(raw)
    better = likely_reading(recorded, raw.conventions, robot, options, clamp_rad)
    if better is not None and (not now.stands or now.beyond_rad > clamp_rad):
        what = now.fault
        if not what and now.beyond_rad > clamp_rad:
            what = furthest_beyond(raw.qpos[:, QPOS_JOINTS], robot.spec)[1]
        what = what or "the robot does not stand upright on the floor"
        raise MotionFileError(f"{what}; {suggestion(raw.conventions, better[0])}")
    if now.fault:
        raise MotionFileError(
            f"{now.fault} in most frames, and no other reading stands upright on the floor at z = "
            f"0 either; --anyway imports it as it is{_remedy(now)}"
        )
    if better is not None and _nearer(better[1], now):
        what = f"its bodies are {now.gap_m:.2f} m from where its joints put them"
        raise MotionFileError(f"{what}; {suggestion(raw.conventions, better[0])}")
    if better is not None and _flatter(better[1], now):
        what = f"the soles are {np.degrees(now.tilt_rad):.0f} degrees off the floor"
        raise MotionFileError(f"{what}; {suggestion(raw.conventions, better[0])}")


def likely_reading(
    recorded: Recorded, read: Conventions, robot: Robot, options: Options, clamp_rad: float
) -> tuple[Conventions, Stance] | None:
    """The other reading in which the robot stands upright on the floor with the flattest soles.

    Of what the user has said nothing is changed; as little as possible of the rest.
    """
    choices = open_choices(recorded)
    free = [key for key in choices if getattr(options, key) is None]
    if recorded.conventions.joint_order == "open":  # the bodies have told it
        free = [key for key in free if key != "joint_order"]
    if (np.abs(recorded.joints).max() > LARGEST_RAD) == (read.angles == "deg"):
        # Radians read as degrees are a robot that stands still, which always looks well.
        free = [key for key in free if key != "angles"]
    readings = [
        replace(read, **dict(zip(free, values, strict=True)))
        for values in combinations(*(choices[key] for key in free))
    ]
    thin, meter = thinned(recorded, FRAMES), StanceMeter(robot)
    found: dict[int, list[tuple[Conventions, Stance]]] = {}
    for reading in readings:
        changes = sum(getattr(reading, key) != getattr(read, key) for key in free)
        stance = _stance_of(thin, reading, robot, meter) if changes else None
        if stance is not None and stance.beyond_rad <= clamp_rad:
            found.setdefault(changes, []).append((reading, stance))
    likely = None
    for _, pairs in sorted(found.items(), key=lambda item: item[0]):
        best = min(pairs, key=lambda pair: pair[1].badness)
        if likely is None or _flatter(best[1], likely[1]) or _nearer(best[1], likely[1]):
            likely = best
    return likely


def _stance_of(
    thin: Recorded, reading: Conventions, robot: Robot, meter: StanceMeter
) -> Stance | None:
    """How the robot stands by that reading; None if it does not."""
    try:
        raw = with_order(thin, reading, robot)
    except MotionFileError:
        return None
    # What is cheap comes first: a pelvis neither too high nor too low, and upright.
    height = float(np.median(raw.qpos[:, 2]))
    up = float(np.median(rotate(raw.qpos[:, ROOT_QUAT], _Z)[:, 2]))
    if not 0.2 < height < 1.2 or up < 0.5:
        return None
    stance = meter.measure(raw)
    return stance if stance.stands else None


def _nearer(other: Stance, now: Stance) -> bool:
    return now.gap_m > _GAP_M and other.gap_m < _NEARER * now.gap_m


def _flatter(other: Stance, now: Stance) -> bool:
    return (
        other.tilt_rad < _FLATTER * now.tilt_rad
        and other.tilt_rad < now.tilt_rad - _FLATTER_BY_RAD
        and other.badness < now.badness
    )


def suggestion(read: Conventions, likely: Conventions) -> str:
    """The reading that is likely, and the options that take it."""
    changed = [k for k in _WORDS if getattr(likely, k) != getattr(read, k)]
    words = " and ".join(_WORDS[key][getattr(likely, key)] for key in changed)
    options = " ".join(f"--{key.replace('_', '-')} {getattr(likely, key)}" for key in changed)
    return f"it looks like {words}: give {options} (or --anyway to import it as it is)"


def _remedy(now: Stance) -> str:
    if now.speed_m_s > SPEED_M_S:
        return ", --fps RATE if its rate is another"
    moved = now.fault.startswith("the lowest point") and now.up > UPRIGHT
    return ", and tlr-motion check --fix puts it on the floor" if moved else ""
