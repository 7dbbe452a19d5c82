"""Finds the columns of a table, time, root and joints, by the names that are in use."""

import re
from dataclasses import dataclass, field

from tlr_exp.robot.spec import RobotSpec

_TIME = {"time", "t", "timestamp", "timestamps", "time_s", "sec", "seconds", "time_stamp"}
_TIME |= {"timestamp_s", "time_sec"}
_FRAME = {"frame", "frames", "frame_id", "frame_idx", "frame_index", "frame_number", "frame_num"}
_FRAME |= {"index", "idx", "id", "step", "unnamed_0", ""}
_ROOT = r"(?:(?:root|base|pelvis|robot|body|floating_base|free|global|world)_)*"
_POSITION = re.compile(
    _ROOT + r"(?:joint_)?(?:(?:translate|translation|trans|position|p|t)_)?(?:pos_)?([xyz])"
    r"(?:_m|_cm|_mm|_pos)?"
)
_QUATERNION = re.compile(
    _ROOT + r"(?:joint_)?(?:quat|quaternion|rot|rotation|orientation|ori|q)_q?([wxyz])"
    r"|" + _ROOT + r"q([wxyz])"
)
_EULER = re.compile(
    _ROOT + r"(?:(?:rotate|rot|rotation|euler|orientation|r)_)?(?:angle_)?(roll|pitch|yaw)"
    r"(?:_deg|_rad)?|" + _ROOT + r"(?:rotate|rotation|rot|euler)_([xyz])(?:_deg|_rad)?"
)
_UNUSED = re.compile(r"(^|_)(vel|velocity|dq|qd|qvel|acc|torque|tau|force|contact|lin|ang)(_|$)")
_CAMEL = re.compile(r"(?<=[a-z0-9])(?=[A-Z])")
_ENDING = re.compile(r"_(dof|pos|position|angle|angles|q|rad|deg|qpos|value)$")
_BEGINNING = re.compile(
    r"^(joint_pos|dof_pos|joints|joint|dof|qpos|q|jpos|k)_(?=left|right|waist|l_|r_)"
)
_BODY_PART = re.compile(r"(left|right|torso|waist|head|neck)_")
_AXES = {"roll": "x", "pitch": "y", "yaw": "z"}


@dataclass
class Columns:
    """Which column of a table is what, by its number.

    Attributes:
        time, frame: of the time and of the frame's number, if any.
        position, quaternion, euler: by their letters; Euler angles by their axes.
        joints: by the names of the joints.
        degrees: what the names of angles say: True, False, or None where they do not.
        seed: the names are those of the table with centimetres and Euler degrees.
        unused: names of columns that say nothing of a pose.
        unknown: names that are not understood.
    """

    time: int | None = None
    frame: int | None = None
    position: dict[str, int] = field(default_factory=dict)
    quaternion: dict[str, int] = field(default_factory=dict)
    euler: dict[str, int] = field(default_factory=dict)
    joints: dict[str, int] = field(default_factory=dict)
    degrees: bool | None = None
    seed: bool = False
    unused: list[str] = field(default_factory=list)
    unknown: list[str] = field(default_factory=list)


def understand(names: tuple[str, ...], spec: RobotSpec) -> Columns:
    """Tell the columns by their names; a name that comes twice counts the first time."""
    columns = Columns(seed=is_seed(names))
    for number, given in enumerate(names):
        _place(columns, number, given, spec)
    if set(columns.quaternion) == {"w"}:
        # Called rotation x, y, z, they would be Euler angles but for the fourth.
        columns.quaternion |= columns.euler
        columns.euler = {}
    return columns


def is_seed(names: tuple[str, ...]) -> bool:
    """Whether a table's names are those of BONES-SEED's."""
    return {"root_translatex", "root_rotatex"} <= {name.lower() for name in names}


def _place(columns: Columns, number: int, given: str, spec: RobotSpec) -> None:
    name = plain(given)
    joint = joint_of(name, spec)
    if joint is not None:
        columns.joints.setdefault(joint, number)
        if name.endswith(("_deg", "_rad")):
            columns.degrees = name.endswith("_deg")
    elif name in _TIME and columns.time is None:
        columns.time = number
    elif name in _FRAME and columns.frame is None:
        columns.frame = number
    elif _UNUSED.search(name):
        columns.unused.append(given)
    elif found := _EULER.fullmatch(name):
        letter = found[1] or found[2]
        columns.euler.setdefault(_AXES.get(letter, letter), number)
        if name.endswith(("_deg", "_rad")):
            columns.degrees = name.endswith("_deg")
    elif found := _QUATERNION.fullmatch(name):
        columns.quaternion.setdefault(found[1] or found[2], number)
    elif found := _POSITION.fullmatch(name):
        columns.position.setdefault(found[1], number)
    else:
        columns.unknown.append(given)


def plain(name: str) -> str:
    """A name in small letters, its parts divided by single underscores."""
    name = _CAMEL.sub("_", name.strip()).lower()
    return re.sub(r"[^a-z0-9]+", "_", name).strip("_")


def joint_of(name: str, spec: RobotSpec) -> str | None:
    """The joint that a plain name means, or None."""
    if "vel" in name.split("_"):
        return None
    said = bool({"joint", "dof"} & set(name.split("_")))
    name = _BEGINNING.sub("", name)
    for _ in range(2):
        name = _ENDING.sub("", name)
    name = re.sub(r"^l_", "left_", re.sub(r"^r_", "right_", name))
    name = name.removesuffix("_joint") + "_joint"
    # Joints of other robots are named, so that the message can say what is wrong.
    other = said and _BODY_PART.match(name)
    return name if name in spec.model_joint_names or other else None
