"""The joints of a file: their names, and the orders in which they come without names."""

import re
from collections.abc import Sequence

from tlr_exp.motion.importers.raw import MotionFileError, listed
from tlr_exp.robot.spec import SIDES, RobotSpec

ORDERS = ("mujoco", "isaac")

_FINGERS = re.compile(r"(left|right)_hand_(thumb|index|middle)_[0-2]_joint")


def in_order(count: int, order: str, spec: RobotSpec) -> tuple[str, ...]:
    """The names of joints that come in the order ``mujoco`` or ``isaac``.

    They are the robot's, or all of its model: for the G1 23 or 29.

    Raises:
        MotionFileError: another number.
    """
    for names in (spec.joint_names, spec.model_joint_names):
        if len(names) == count:
            return by_level(names, spec) if order == "isaac" else names
    expected = f"{spec.num_joints} or {len(spec.model_joint_names)}"
    raise MotionFileError(f"it has {count} joints; expected {expected}{_robot_of(count)}")


def by_level(names: tuple[str, ...], spec: RobotSpec) -> tuple[str, ...]:
    """Joints [limb by limb] in Isaac Lab's order: by their distance from the pelvis."""
    limbs: dict[str, int] = {}
    levels = []
    for name in names:
        limb = _limb(name, spec)
        # The arms begin at the torso, below the joints of the waist.
        limbs[limb] = limbs.get(limb, len(spec.waist) if limb.endswith("arm") else 0) + 1
        levels.append(limbs[limb])
    return tuple(name for _, name in sorted(zip(levels, names, strict=True), key=lambda x: x[0]))


def _limb(name: str, spec: RobotSpec) -> str:
    side, _, kind = name.removesuffix("_joint").partition("_")
    if side not in SIDES:
        return "waist"
    return f"{side} {'leg' if kind in spec.legs else 'arm'}"


def links_of(joints: Sequence[str], spec: RobotSpec) -> tuple[str, ...]:
    """The pelvis and the links that the joints move, in their order."""
    links = {joint.name: joint.link for joint in spec.joints}
    return spec.pelvis_name, *(links.get(n, n.replace("_joint", "_link")) for n in joints)


def check_joints(names: Sequence[str], spec: RobotSpec) -> tuple[str, ...]:
    """Refuse names that are not those of the robot; returns those that are of no use to us.

    Raises:
        MotionFileError: joints missing or named twice; the message lists unknown ones, too.
    """
    known = {*spec.joint_names, *spec.model_joint_names}
    unknown = tuple(n for n in names if n not in known and not _FINGERS.fullmatch(n))
    missing = [n for n in spec.joint_names if n not in names]
    twice = sorted({n for n in names if names.count(n) > 1})
    if not missing and not twice:
        return unknown
    faults = (("unknown joints", unknown), ("missing joints", missing), ("twice", twice))
    text = "; ".join(f"{what}: {listed(found)}" for what, found in faults if found)
    other = ""
    if "torso_joint" in names:
        other = "; with a torso_joint it may be an H1, an H1-2, or a G1 of 2024's first model"
    raise MotionFileError(f"its joints are not those of the {spec.name}; {text}{other}")


def _robot_of(count: int) -> str:
    robots = {19: "H1", 27: "H1-2"}
    return f"; {count} joints are those of Unitree's {robots[count]}" if count in robots else ""
