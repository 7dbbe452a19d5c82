"""The keyframe language: reading a YAML file of poses, and refusing what it does not know.

docs/keyframes.md describes the language. Every movable quantity is a channel (a joint of the upper
body, the height of the pelvis, the x of a foot ...). A keyframe gives a knot to the channels that
it mentions, and the others pass it by.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from numbers import Real
from typing import Any

import yaml

from tlr_exp.errors import UserError
from tlr_exp.robot.spec import SIDES, RobotSpec

FOOT_CHANNELS = ("x_m", "y_m", "z_m", "yaw", "pitch")

_TOP_KEYS = ("fps", "description", "keyframes")
_PELVIS_KEYS = ("height_m", "yaw_deg", "pitch_deg", "roll_deg")
_FOOT_KEYS = ("x_m", "y_m", "z_m", "yaw_deg", "pitch_deg", "swing_s", "lift_m")
_KEYFRAME_KEYS = (
    *("time_s", "name", "like", "pelvis", "weight_on_right", "left_foot", "right_foot"),
    *("waist_deg", "arms_deg", "left_arm_deg", "right_arm_deg"),
    *("hands_m", "left_hand_m", "right_hand_m"),
)

DEFAULT_FPS = 50.0
DEFAULT_LIFT_M = 0.05

# Joint angles in radians of an arm (side, target in the torso's frame in m, angles to start from).
HandSolver = Callable[[str, list[float], list[float]], list[float]]


class KeyframeError(UserError):
    """A keyframe file that cannot be understood, or a motion that cannot be performed."""


@dataclass(frozen=True)
class Swing:
    """A foot on its way; ``lift_m`` is how far it rises between two places on the floor."""

    start_s: float
    end_s: float
    lift_m: float


@dataclass
class Script:
    """What a keyframe file says.

    Attributes:
        fps: frames a second of the clip to be made.
        duration_s: time of the last keyframe.
        knots: per channel, (time in s, value in m or rad), in order of time. Channels are the
            joints of waist and arms by name, ``pelvis.KEY``, ``left_foot.KEY``,
            ``right_foot.KEY`` and ``weight_on_right``.
        swings: per side, when the foot moves.
        names: keyframe name to time in s.
    """

    fps: float
    duration_s: float = 0.0
    knots: dict[str, list[tuple[float, float]]] = field(default_factory=dict)
    swings: dict[str, list[Swing]] = field(default_factory=lambda: {side: [] for side in SIDES})
    names: dict[str, float] = field(default_factory=dict)


def default_pose(spec: RobotSpec) -> dict[str, float]:
    """Every channel's value where no keyframe has said anything: the robot's stance."""
    stance = spec.stance
    pose = {spec.joint_names[i]: float(stance.joint_pos_rad[i]) for i in spec.upper_joints}
    pose |= {f"pelvis.{key}": 0.0 for key in ("yaw", "pitch", "roll")}
    pose["pelvis.height_m"] = stance.height_m
    pose["weight_on_right"] = 0.5
    for side, sign in zip(SIDES, (1.0, -1.0), strict=True):
        pose |= {f"{side}_foot.{key}": 0.0 for key in FOOT_CHANNELS}
        pose[f"{side}_foot.y_m"] = sign * stance.half_width_m
    return pose


def read_script(text: str, spec: RobotSpec, solve_hand: HandSolver) -> Script:
    """Read the text of a keyframe file.

    Args:
        text: YAML.
        spec: the robot that moves.
        solve_hand: inverse kinematics of one arm, for keyframes that place a hand.

    Raises:
        KeyframeError: a wrong key, type, order or value; the message names the keyframe and what
            is allowed.
    """
    try:
        data = yaml.safe_load(text)
    except yaml.YAMLError as error:
        raise KeyframeError(f"not a YAML file: {error}") from error
    _check_keys(data, _TOP_KEYS, "the file")
    keyframes = data.get("keyframes")
    if not isinstance(keyframes, list) or len(keyframes) < 2:
        raise KeyframeError("keyframes: expected a list of at least two keyframes")
    fps = _number(data.get("fps", DEFAULT_FPS), "fps")
    if fps <= 0:
        raise KeyframeError(f"fps is {fps}; it must be positive")
    reader = _Reader(Script(fps=fps), spec, solve_hand)
    for number, keyframe in enumerate(keyframes, start=1):
        reader.read(keyframe, f"keyframe {number}")
    return reader.script


class _Reader:
    """Reads keyframes in order; remembers the pose so far and the poses that have names."""

    def __init__(self, script: Script, spec: RobotSpec, solve_hand: HandSolver) -> None:
        self.script = script
        self.spec = spec
        self.solve_hand = solve_hand
        self.pose = default_pose(spec)
        self.named_poses: dict[str, dict[str, float]] = {}

    def read(self, keyframe: Any, where: str) -> None:
        _check_keys(keyframe, _KEYFRAME_KEYS, where)
        where = f"{where} ({keyframe['name']})" if "name" in keyframe else where
        time_s = _number(keyframe.get("time_s"), f"{where}: time_s")
        first = not self.script.knots
        if first and time_s != 0:
            raise KeyframeError(f"{where}: time_s is {time_s}; the first keyframe is at 0")
        if not first and time_s <= self.script.duration_s:
            raise KeyframeError(
                f"{where}: time_s is {time_s}; it must come after {self.script.duration_s}"
            )
        stated = self._like(keyframe, where) | self._stated(keyframe, where)
        if first:
            stated = self.pose | stated
            self.script.knots = {channel: [(0.0, value)] for channel, value in stated.items()}
        else:
            self._move_feet(keyframe, stated, time_s, where)
            for channel, value in stated.items():
                if "_foot." not in channel:
                    self.script.knots[channel].append((time_s, value))
        self.pose |= stated
        self.script.duration_s = time_s
        if "name" in keyframe:
            self._remember(str(keyframe["name"]), time_s, where)

    def _remember(self, name: str, time_s: float, where: str) -> None:
        if name in self.named_poses:
            raise KeyframeError(f"{where}: there is another keyframe of this name")
        self.named_poses[name] = dict(self.pose)
        self.script.names[name] = time_s

    def _like(self, keyframe: Mapping[str, Any], where: str) -> dict[str, float]:
        if "like" not in keyframe:
            return {}
        name = str(keyframe["like"])
        if name not in self.named_poses:
            raise KeyframeError(
                f"{where}: like: there is no earlier keyframe {name!r}; "
                f"earlier names are {', '.join(self.named_poses) or '(none)'}"
            )
        return dict(self.named_poses[name])

    def _stated(self, keyframe: Mapping[str, Any], where: str) -> dict[str, float]:
        """The channels that a keyframe mentions itself."""
        out: dict[str, float] = {}
        for key, value in _numbers(keyframe, "pelvis", _PELVIS_KEYS, where).items():
            out[f"pelvis.{key}"] = value
        waist = tuple(kind.removeprefix("waist_") for kind in self.spec.waist)
        for key, value in _numbers(keyframe, "waist_deg", waist, where).items():
            out[f"waist_{key}_joint"] = value
        if "weight_on_right" in keyframe:
            share = _number(keyframe["weight_on_right"], f"{where}: weight_on_right")
            if not 0 <= share <= 1:
                raise KeyframeError(f"{where}: weight_on_right is {share}; it lies in [0, 1]")
            out["weight_on_right"] = share
        for side in SIDES:
            foot = f"{side}_foot"
            for key, value in _numbers(keyframe, foot, _FOOT_KEYS, where).items():
                if key in FOOT_CHANNELS:
                    out[f"{foot}.{key}"] = value
            out |= self._arm(keyframe, side, where)
        return out

    def _arm(self, keyframe: Mapping[str, Any], side: str, where: str) -> dict[str, float]:
        arms = self.spec.arms
        names = {joint: f"{side}_{joint}_joint" for joint in arms}
        out: dict[str, float] = {}
        for key in ("arms_deg", f"{side}_arm_deg"):
            for joint, value in _numbers(keyframe, key, arms, where).items():
                # Both arms are written as the left one.
                mirrored = side == "right" and joint in self.spec.mirrored
                out[names[joint]] = -value if mirrored else value
        for key in ("hands_m", f"{side}_hand_m"):
            if key in keyframe:
                target = _triple(keyframe[key], f"{where}: {key}")
                if side == "right":
                    target[1] = -target[1]
                start = [(self.pose | out)[name] for name in names.values()]
                try:
                    angles = self.solve_hand(side, target, start)
                except ValueError as error:
                    raise KeyframeError(f"{where}: {key}: {error}") from error
                out |= dict(zip(names.values(), angles, strict=True))
        return out

    def _move_feet(
        self, keyframe: Mapping[str, Any], stated: Mapping[str, float], time_s: float, where: str
    ) -> None:
        for side in SIDES:
            foot = f"{side}_foot"
            spec = _numbers(keyframe, foot, _FOOT_KEYS, where)
            before = {key: self.pose[f"{foot}.{key}"] for key in FOOT_CHANNELS}
            after = {key: stated.get(f"{foot}.{key}", before[key]) for key in FOOT_CHANNELS}
            if after["z_m"] < 0 or (after["z_m"] == 0 and after["pitch"] != 0):
                raise KeyframeError(
                    f"{where}: {foot}: a foot is flat on the floor (z_m 0, pitch_deg 0) or above it"
                )
            if before == after and "lift_m" not in spec:
                continue
            start_s = self._swing_start(side, spec, time_s, f"{where}: {foot}")
            on_floor = before["z_m"] == after["z_m"] == 0
            lift = spec.get("lift_m", DEFAULT_LIFT_M if on_floor else 0.0)
            self.script.swings[side].append(Swing(start_s, time_s, lift))
            for key in FOOT_CHANNELS:
                knots = self.script.knots[f"{foot}.{key}"]
                if knots[-1][0] < start_s:
                    knots.append((start_s, before[key]))
                knots.append((time_s, after[key]))

    def _swing_start(
        self, side: str, spec: Mapping[str, float], time_s: float, where: str
    ) -> float:
        last_knot_s = self.script.knots[f"{side}_foot.x_m"][-1][0]
        in_the_air = self.pose[f"{side}_foot.z_m"] > 0
        earliest = last_knot_s if in_the_air else self.script.duration_s
        start_s = time_s - spec["swing_s"] if "swing_s" in spec else earliest
        if abs(start_s - last_knot_s) < 1e-9:
            start_s = last_knot_s
        if not last_knot_s <= start_s < time_s:
            raise KeyframeError(
                f"{where}: swing_s is {spec.get('swing_s')}; the swing ends at {time_s} s and may "
                f"begin at {last_knot_s} s at the earliest"
            )
        return start_s


def _check_keys(data: Any, allowed: tuple[str, ...], where: str) -> None:
    if not isinstance(data, Mapping):
        raise KeyframeError(f"{where}: expected keys and values, got {data!r}")
    unknown = [str(key) for key in data if key not in allowed]
    if unknown:
        raise KeyframeError(
            f"{where}: unknown key {', '.join(unknown)}; allowed are {', '.join(allowed)}"
        )


def _numbers(
    keyframe: Mapping[str, Any], key: str, allowed: tuple[str, ...], where: str
) -> dict[str, float]:
    """The numbers under ``key``, degrees as radians; empty where there is no such key.

    ``_deg`` at the end of a name says degrees, and is dropped from it.
    """
    if key not in keyframe:
        return {}
    _check_keys(keyframe[key], allowed, f"{where}: {key}")
    out = {}
    for name, value in keyframe[key].items():
        number = _number(value, f"{where}: {key}: {name}")
        degrees = name.endswith("_deg") or key.endswith("_deg")
        out[name.removesuffix("_deg")] = math.radians(number) if degrees else number
    return out


def _number(value: Any, where: str) -> float:
    if not isinstance(value, Real) or isinstance(value, bool) or not math.isfinite(value):
        raise KeyframeError(f"{where}: expected a number, got {value!r}")
    return float(value)


def _triple(value: Any, where: str) -> list[float]:
    if not isinstance(value, list) or len(value) != 3:
        raise KeyframeError(f"{where}: expected [x, y, z] in metres, got {value!r}")
    return [_number(number, where) for number in value]
