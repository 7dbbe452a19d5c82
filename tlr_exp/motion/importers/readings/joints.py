"""The joints of a file: their names, and the orders in which they come without names."""

import re
from collections.abc import Sequence

from tlr_exp.motion.importers.raw import MotionFileError, listed
from tlr_exp.robot.g1 import JOINT_NAMES

PELVIS = "pelvis"
ORDERS = ("mujoco", "isaac")

_ARM_ENDS = ("wrist_roll_joint", "wrist_pitch_joint", "wrist_yaw_joint")
# The 29 joints in the order of the robot's model files, the order of Unitree's own data.
JOINT_NAMES_29 = (
    *JOINT_NAMES[:19],
    *(f"left_{name}" for name in _ARM_ENDS),
    *JOINT_NAMES[19:],
    *(f"right_{name}" for name in _ARM_ENDS),
)
# Joints that the 23-joint robot does not have, though a file may: wrists and fingers.
_DROPPED = re.compile(
    r"(left|right)_(wrist_(roll|pitch|yaw)|hand_(thumb|index|middle)_[0-2])_joint"
)


def in_order(count: int, order: str) -> tuple[str, ...]:
    """The names of 23 or 29 joints that come in the order ``mujoco`` or ``isaac``.

    Raises:
        MotionFileError: another number.
    """
    for names in (JOINT_NAMES, JOINT_NAMES_29):
        if len(names) == count:
            return by_level(names) if order == "isaac" else names
    raise MotionFileError(f"it has {count} joints; expected 23 or 29{_robot_of(count)}")


def by_level(names: tuple[str, ...]) -> tuple[str, ...]:
    """Joints [limb by limb] in Isaac Lab's order: by their distance from the pelvis."""
    limbs: dict[str, int] = {}
    levels = []
    for name in names:
        limb = _limb(name)
        # The arms begin at the torso, below the three joints of the waist.
        limbs[limb] = limbs.get(limb, 3 if limb.endswith("arm") else 0) + 1
        levels.append(limbs[limb])
    return tuple(name for _, name in sorted(zip(levels, names, strict=True), key=lambda x: x[0]))


def _limb(name: str) -> str:
    side = name.split("_")[0]
    if side == "waist":
        return side
    leg = any(part in name for part in ("hip", "knee", "ankle"))
    return f"{side} {'leg' if leg else 'arm'}"


def link_of(joint: str) -> str:
    """The link that a joint moves."""
    return "torso_link" if joint == "waist_pitch_joint" else joint.replace("_joint", "_link")


def links_of(joints: Sequence[str]) -> tuple[str, ...]:
    """The pelvis and the links that the joints move, in their order."""
    return PELVIS, *map(link_of, joints)


def check_joints(names: Sequence[str]) -> tuple[str, ...]:
    """Refuse names that are not those of the G1; returns those that are of no use to us.

    Raises:
        MotionFileError: joints missing or named twice; the message lists unknown ones, too.
    """
    unknown = tuple(n for n in names if n not in JOINT_NAMES and not _DROPPED.fullmatch(n))
    missing = [n for n in JOINT_NAMES if n not in names]
    twice = sorted({n for n in names if names.count(n) > 1})
    if not missing and not twice:
        return unknown
    faults = (("unknown joints", unknown), ("missing joints", missing), ("twice", twice))
    text = "; ".join(f"{what}: {listed(found)}" for what, found in faults if found)
    other = ""
    if "torso_joint" in names:
        other = "; with a torso_joint it may be an H1, an H1-2, or a G1 of 2024's first model"
    raise MotionFileError(f"its joints are not those of the G1; {text}{other}")


def _robot_of(count: int) -> str:
    robots = {19: "H1", 27: "H1-2"}
    return f"; {count} joints are those of Unitree's {robots[count]}" if count in robots else ""
