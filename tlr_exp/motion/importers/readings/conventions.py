"""From what a file holds to our conventions: metres, radians, z up, quaternions w x y z."""

from dataclasses import replace

import numpy as np

from tlr_exp.motion.checks import UNIT_QUAT_TOLERANCE
from tlr_exp.motion.importers.raw import (
    Bodies,
    Conventions,
    FileBodies,
    ImplausibleError,
    MotionFileError,
    Options,
    RawMotion,
    Recorded,
    listed,
)
from tlr_exp.motion.importers.readings.joints import check_joints, in_order, links_of
from tlr_exp.motion.quaternions import product, rotate
from tlr_exp.robot.spec import RobotSpec

METRES = {"m": 1.0, "cm": 0.01, "mm": 0.001}
# What may be said of a file by an option, and its choices; ``Conventions`` explains them.
CHOICES: dict[str, tuple[str, ...]] = {
    "units": tuple(METRES),
    "quaternion": ("xyzw", "wxyz"),
    "up": ("z", "y"),
    "angles": ("rad", "deg"),
    "joint_order": ("mujoco", "isaac"),
}
LARGEST_RAD = 7.0  # no joint of a motion is turned further
MAX_POSITION_M = 1000.0
# Projects that blend quaternions linearly leave them shorter than 1: at 0.9, two that are 52
# degrees apart. What is shorter still is no orientation.
NORM_RANGE = 0.9, 1.1

_HALF = np.sqrt(0.5)
_Y_TO_Z = np.array([_HALF, _HALF, 0.0, 0.0])  # a quarter turn about x
_UP = np.array([0.0, 0.0, 1.0])


def open_choices(recorded: Recorded) -> dict[str, tuple[str, ...]]:
    """What a file does not state itself, and its choices; an order only of joints without names."""
    named = set() if recorded.conventions.joint_order else {"joint_order"}
    return {key: CHOICES[key] for key in CHOICES if key not in recorded.told | named}


def of_options(recorded: Recorded, options: Options) -> Conventions:
    """The conventions of a file's format, with those of the options in their place.

    Raises:
        MotionFileError: an unknown choice.
    """
    for key, choices in CHOICES.items():
        value = getattr(options, key)
        if value is not None and value not in choices:
            raise MotionFileError(f"{key} is {value!r}; expected {' or '.join(choices)}")
    asked = {key: getattr(options, key) for key in open_choices(recorded)}
    asked = {key: value for key, value in asked.items() if value is not None}
    return replace(recorded.conventions, **asked)


def interpret(recorded: Recorded, conventions: Conventions, spec: RobotSpec) -> RawMotion:
    """Read what a file holds by the conventions given.

    Joints that our robot does not have are dropped. Quaternions of a norm near 1 are normalised,
    and it is noted how many and how far.

    Raises:
        MotionFileError: joints unknown, missing or named twice; fewer than two frames.
        ImplausibleError: a quaternion far from unit length, or a root that is kilometres away.
    """
    if len(recorded.joints) < 2:
        raise MotionFileError(f"it has {len(recorded.joints)} frame(s); a motion needs at least 2")
    notes = list(recorded.notes)
    names = recorded.names
    if names is None:
        names = in_order(recorded.joints.shape[1], conventions.joint_order, spec)
    unknown = check_joints(names, spec)
    notes += [f"joints that are not used: {listed(unknown)}"] if unknown else []
    joints = recorded.joints[:, [names.index(name) for name in spec.joint_names]]
    if conventions.angles == "deg":
        joints = np.radians(joints)
    scale = METRES[conventions.units]
    position, quats = recorded.position * scale, recorded.quats
    if conventions.quaternion == "xyzw":
        quats = np.roll(quats, 1, axis=-1)
    quats, said = _unit(quats)
    notes += said
    if conventions.up == "y":
        position, (quats, how) = _turned(position), _upright(quats)
        notes.append(f"the y axis pointed up: {how}")
    if np.abs(position).max() > MAX_POSITION_M:
        raise ImplausibleError(
            f"the root is {np.abs(position).max():.3g} m from the origin; positions are in metres "
            f"and at most {MAX_POSITION_M:g}"
        )
    qpos = np.concatenate([position, quats, joints], axis=1)
    nameless = names if recorded.names is None else None
    bodies = _bodies(recorded.bodies, nameless, qpos, conventions, spec)
    return RawMotion(recorded.fps, qpos, bodies, conventions, tuple(notes))


def _unit(quats: np.ndarray) -> tuple[np.ndarray, list[str]]:
    """Quaternions [T, 4] made unit where they are nearly so; those that are keep every bit."""
    norms = np.linalg.norm(quats, axis=-1)
    worst = int(np.abs(norms - 1).argmax())
    low, high = NORM_RANGE
    if not low <= norms[worst] <= high:
        raise ImplausibleError(
            f"the root quaternion of frame {worst} has norm {norms[worst]:.4g}; expected 1"
        )
    off = np.abs(norms - 1) > UNIT_QUAT_TOLERANCE
    if not off.any():
        return quats, []
    quats = np.where(off[:, None], quats / norms[:, None], quats)
    return quats, [
        f"the root quaternion had another norm than 1 in {off.sum()} of {len(off)} frames "
        f"({norms.min():.3f} to {norms.max():.3f}): made unit"
    ]


def _turned(positions: np.ndarray) -> np.ndarray:
    """Positions [..., 3] of a world whose y axis points up, in one whose z axis does."""
    x, y, z = np.moveaxis(positions, -1, 0)
    return np.stack([x, -z, y], axis=-1)


def _upright(quats: np.ndarray) -> tuple[np.ndarray, str]:
    """Orientations [T, 4] of a world whose y axis points up, in one whose z axis does.

    Three ways are in use: the world alone was turned; the axes of world and pelvis were renamed
    alike; the positions alone were turned. Taken is the way in which the pelvis is most upright.
    """
    inverse = _Y_TO_Z * np.array([1.0, -1.0, -1.0, -1.0])
    ways = {
        "positions and orientations were turned": product(_Y_TO_Z, quats),
        "the axes of positions and orientations were renamed": product(
            product(_Y_TO_Z, quats), inverse
        ),
        "positions were turned, the orientations were right": quats,
    }
    # Rounded, so that the first of equals is taken.
    upright = {how: round(np.median(rotate(q, _UP)[:, 2]), 6) for how, q in ways.items()}
    how = max(upright, key=lambda key: upright[key])
    return ways[how], how


def _bodies(
    found: FileBodies | None,
    nameless: tuple[str, ...] | None,
    qpos: np.ndarray,
    conventions: Conventions,
    spec: RobotSpec,
) -> Bodies | None:
    """Body positions in our conventions; ``nameless``: the joints, where the file names none."""
    if found is None:
        return None
    pos = found.pos * METRES[conventions.units]
    if found.local:
        pos = qpos[:, None, :3] + rotate(qpos[:, None, 3:7], pos)
    elif conventions.up == "y":
        pos = _turned(pos)
    names = found.names
    if names is None and nameless is not None and pos.shape[1] == len(nameless) + 1:
        names = links_of(nameless, spec)
    if names is None:
        return Bodies(None, pos) if pos.shape[1] > spec.num_joints + 1 else None
    kept = [name for name in spec.tracked_bodies if name in names]
    if not kept:
        return None
    return Bodies(tuple(kept), pos[:, [names.index(name) for name in kept]])
