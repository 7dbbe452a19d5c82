"""BeyondMimic's and mjlab's ``.npz``: nameless joints, and the poses of all bodies.

BeyondMimic writes joints and bodies in the order of Isaac Lab (level by level from the pelvis),
mjlab in that of MuJoCo (limb by limb), under the same keys and shapes. Both readings are returned;
the body positions tell which one is right.
"""

from collections.abc import Mapping
from typing import Any

from tlr_exp.motion.importers.raw import (
    MotionFileError,
    Options,
    RawMotion,
    assemble,
    nameless,
    take,
    take_rate,
    tracked,
)

ORDERS = ("mujoco", "isaac")
PELVIS = "pelvis"


def read(content: Mapping[str, Any], options: Options) -> list[RawMotion]:
    """One reading per possible joint order; the pelvis is the first body.

    Raises:
        MotionFileError: see ``raw``; or the number of bodies does not fit that of the joints, and
            no joint order is given.
    """
    joints = take(content, "joint_pos", None)
    position = take(content, "body_pos_w", None, 3, frames=len(joints))
    quats = take(content, "body_quat_w", position.shape[1], 4, frames=len(joints))
    if not position.shape[1]:
        raise MotionFileError("body_pos_w has no bodies; the first must be the pelvis")
    rate = take_rate(content, "fps", options)
    names = nameless(joints.shape[1])
    compared = position.shape[1] == len(names) + 1
    if not compared and options.joint_order is None:
        raise MotionFileError(
            f"it has {position.shape[1]} bodies, which do not tell the order of its {len(names)} "
            "joints; give --joint-order mujoco (mjlab) or isaac (BeyondMimic)"
        )
    readings = []
    for order in ORDERS if options.joint_order is None else (options.joint_order,):
        ordered = names if order == "mujoco" else by_level(names)
        qpos = assemble(position[:, 0], quats[:, 0], joints, ordered)
        bodies = tracked([PELVIS, *map(link_of, ordered)], position) if compared else None
        readings.append(RawMotion(rate, qpos, bodies, order))
    return readings


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
