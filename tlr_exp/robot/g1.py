"""The Unitree G1 with 23 actuated joints: names, limits, gains and default poses.

The numbers are those of the paper's lineage: ranges, efforts and speeds of the real robot; two
sets of PD gains, ``beyondmimic`` (derived from the motors' reflected inertia) and ``asap``.
"""

from dataclasses import dataclass

import numpy as np

SIM_DT_S = 0.005
DECIMATION = 4
CONTROL_DT_S = SIM_DT_S * DECIMATION

GAIN_SETS = ("beyondmimic", "asap")
COLLISION_SETS = ("feet", "full")


@dataclass(frozen=True)
class Gains:
    """PD control of one joint: default pose (rad), stiffness (N m/rad), damping (N m s/rad),
    rotor inertia as seen at the joint (kg m^2), and rad per unit of action."""

    default_pos: float
    kp: float
    kd: float
    armature: float
    action_scale: float


@dataclass(frozen=True)
class Joint:
    """One kind of joint; left and right share it, and the range (rad) is that of the left.

    Effort in N m, velocity in rad/s.
    """

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
JOINTS: dict[str, Joint] = {
    "hip_pitch": Joint((-2.5307, 2.8798), 88, 32, _asap(-0.1, 100, 2.5), _motor_7520_14(-0.312)),
    "hip_roll": Joint((-0.5236, 2.9671), 139, 20, _asap(0, 100, 2.5), _motor_7520_22(0)),
    "hip_yaw": Joint((-2.7576, 2.7576), 88, 32, _asap(0, 100, 2.5), _motor_7520_14(0)),
    "knee": Joint((-0.0873, 2.8798), 139, 20, _asap(0.3, 200, 5), _motor_7520_22(0.669)),
    "ankle_pitch": Joint((-0.8727, 0.5236), 50, 37, _asap(-0.2, 20, 0.2), _motor_5020_pair(-0.363)),
    "ankle_roll": Joint((-0.2618, 0.2618), 50, 37, _asap(0, 20, 0.1), _motor_5020_pair(0)),
    "waist_yaw": Joint((-2.618, 2.618), 88, 32, _asap(0, 400, 5), _motor_7520_14(0)),
    "waist_roll": Joint((-0.52, 0.52), 50, 37, _asap(0, 400, 5), _motor_5020_pair(0)),
    "waist_pitch": Joint((-0.52, 0.52), 50, 37, _asap(0, 400, 5), _motor_5020_pair(0)),
    "shoulder_pitch": Joint((-3.0892, 2.6704), 25, 37, _asap(0, 90, 2), _motor_5020(0.2)),
    "shoulder_roll": Joint((-1.5882, 2.2515), 25, 37, _asap(0, 60, 1), _motor_5020(0.2)),
    "shoulder_yaw": Joint((-2.618, 2.618), 25, 37, _asap(0, 20, 0.4), _motor_5020(0)),
    "elbow": Joint((-1.0472, 2.0944), 25, 37, _asap(0, 60, 1), _motor_5020(0.6)),
}
# fmt: on
# Roll joints are mirrored between left and right: range and default change sign.
_MIRRORED = ("hip_roll", "ankle_roll", "shoulder_roll")

# Kinds of joints; left and right have one each, but for the waist.
LEG = ("hip_pitch", "hip_roll", "hip_yaw", "knee", "ankle_pitch", "ankle_roll")
WAIST = ("waist_yaw", "waist_roll", "waist_pitch")
ARM = ("shoulder_pitch", "shoulder_roll", "shoulder_yaw", "elbow")

JOINT_NAMES: tuple[str, ...] = (
    *(f"left_{name}_joint" for name in LEG),
    *(f"right_{name}_joint" for name in LEG),
    *(f"{name}_joint" for name in WAIST),
    *(f"left_{name}_joint" for name in ARM),
    *(f"right_{name}_joint" for name in ARM),
)
NUM_JOINTS = len(JOINT_NAMES)

# Points that are tracked although no link of the robot sits there: parent link and offset in m.
EXTENDED_BODIES: dict[str, tuple[str, tuple[float, float, float]]] = {
    "left_hand": ("left_elbow_link", (0.25, 0.0, 0.0)),
    "right_hand": ("right_elbow_link", (0.25, 0.0, 0.0)),
    "head": ("torso_link", (0.0, 0.0, 0.42)),
}
LINK_NAMES: tuple[str, ...] = (
    "pelvis",
    *(f"left_{name}_link" for name in LEG),
    *(f"right_{name}_link" for name in LEG),
    "waist_yaw_link",
    "waist_roll_link",
    "torso_link",
    *(f"left_{name}_link" for name in ARM),
    *(f"right_{name}_link" for name in ARM),
)
TRACKED_BODIES: tuple[str, ...] = (*LINK_NAMES, *EXTENDED_BODIES)


def _indices(*names: str) -> tuple[int, ...]:
    return tuple(TRACKED_BODIES.index(name) for name in names)


UPPER_BODY = _indices(*(n for n in LINK_NAMES if "shoulder" in n or "elbow" in n), *EXTENDED_BODIES)
LOWER_BODY = tuple(i for i in range(len(TRACKED_BODIES)) if i not in UPPER_BODY)
THREE_POINTS = _indices("left_hand", "right_hand", "head")
FOOT_BODIES = ("left_ankle_roll_link", "right_ankle_roll_link")
FEET = _indices(*FOOT_BODIES)
PELVIS = TRACKED_BODIES.index("pelvis")


def joint_tables(gains: str) -> dict[str, np.ndarray]:
    """The columns of ``JOINTS`` for the 23 joints, left and right, under one set of gains.

    Returns:
        Float64 arrays of 23 rows in the order of ``JOINT_NAMES``, named as the fields of
        ``tlr_exp.robot.model.Robot``.
    """
    rows = [_joint_row(name, gains) for name in JOINT_NAMES]
    return {column: np.array([row[column] for row in rows]) for column in rows[0]}


def _joint_row(name: str, gains: str) -> dict[str, float | tuple[float, float]]:
    side, _, kind = name.removesuffix("_joint").partition("_")
    if side == "waist":
        kind = f"waist_{kind}"
    joint = JOINTS[kind]
    control: Gains = getattr(joint, gains)
    low, high = joint.range
    mirrored = side == "right" and kind in _MIRRORED
    return {
        "joint_range_rad": (-high, -low) if mirrored else (low, high),
        "effort_limit_nm": float(joint.effort),
        "velocity_limit_rad_s": float(joint.velocity),
        "default_joint_pos_rad": -control.default_pos if mirrored else control.default_pos,
        "action_scale_rad": control.action_scale,
        "kp": control.kp,
        "kd": control.kd,
        "armature": control.armature,
    }
