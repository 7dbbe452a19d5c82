"""``RobotSpec``: what a robot is, as one value: its joints, its bodies, and how they are grouped.

Whatever has to know the robot is given this, alone or as part of a ``Robot`` or a clip.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

SIDES = ("left", "right")


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
    """One joint and the link that it moves; range in rad, effort in N m, velocity in rad/s.

    Left and right have one of each ``kind``; ``side`` is empty in the middle of the body.
    """

    name: str
    kind: str
    side: str
    link: str
    range: tuple[float, float]
    effort: float
    velocity: float
    gains: Mapping[str, Gains]


@dataclass(frozen=True)
class Point:
    """A point that is tracked although no link has its origin there: its link, and where on it."""

    name: str
    link: str
    offset_m: tuple[float, float, float]


@dataclass(frozen=True)
class Stance:
    """How the robot stands where a motion says nothing else.

    Attributes:
        joint_pos_rad: of every joint.
        height_m: of the pelvis, the soles on the floor.
        half_width_m: of a foot from the middle.
        com_below_pelvis_m: about where the centre of mass is.
    """

    joint_pos_rad: tuple[float, ...]
    height_m: float
    half_width_m: float
    com_below_pelvis_m: float


@dataclass(frozen=True)
class RobotSpec:
    """A robot with a pelvis, a waist, and two legs and arms.

    Tracked bodies are the links and then the points. Properties without ``names`` in their name
    are indices among them, or among the joints.

    Attributes:
        name: as people call it.
        model_package, model_path: the installed package that holds the model, and where in it.
        joints: in the order of the model, all that are actuated.
        model_joint_names: all that the model has, with those that are welded.
        points: tracked besides the links.
        pelvis_name, torso_name, head_name: links or points.
        hand_names, foot_names, hip_names: likewise, left and right; a hip is where its leg can
            swing to the side.
        legs, waist, arms: kinds of joints, from the pelvis outwards.
        mirrored: kinds of joints whose angle has the other sign on the right.
        stance: how it stands.
    """

    name: str
    model_package: str
    model_path: str
    joints: tuple[Joint, ...]
    model_joint_names: tuple[str, ...]
    points: tuple[Point, ...]
    pelvis_name: str
    torso_name: str
    head_name: str
    hand_names: tuple[str, str]
    foot_names: tuple[str, str]
    hip_names: tuple[str, str]
    legs: tuple[str, ...]
    waist: tuple[str, ...]
    arms: tuple[str, ...]
    mirrored: tuple[str, ...]
    stance: Stance

    @cached_property
    def joint_names(self) -> tuple[str, ...]:
        return tuple(joint.name for joint in self.joints)

    @cached_property
    def link_names(self) -> tuple[str, ...]:
        """The pelvis and the links that the joints move."""
        return (self.pelvis_name, *(joint.link for joint in self.joints))

    @cached_property
    def tracked_bodies(self) -> tuple[str, ...]:
        return (*self.link_names, *(point.name for point in self.points))

    @property
    def num_joints(self) -> int:
        return len(self.joints)

    @property
    def num_bodies(self) -> int:
        return len(self.tracked_bodies)

    @property
    def num_qpos(self) -> int:
        """Length of MuJoCo's ``qpos``: place and quaternion of the pelvis, then the joints."""
        return 7 + self.num_joints

    @property
    def num_qvel(self) -> int:
        return 6 + self.num_joints

    @cached_property
    def upper_body(self) -> tuple[int, ...]:
        """Arms, hands and head."""
        arms = (joint.link for joint in self.joints if joint.kind in self.arms)
        return self.bodies((*arms, *(point.name for point in self.points)))

    @cached_property
    def lower_body(self) -> tuple[int, ...]:
        """All that is not of the upper body: pelvis, legs and torso."""
        return tuple(i for i in range(self.num_bodies) if i not in self.upper_body)

    @cached_property
    def three_points(self) -> tuple[int, ...]:
        """Hands and head."""
        return self.bodies((*self.hand_names, self.head_name))

    @cached_property
    def feet(self) -> tuple[int, ...]:
        return self.bodies(self.foot_names)

    @cached_property
    def pelvis(self) -> int:
        return self.tracked_bodies.index(self.pelvis_name)

    @cached_property
    def upper_joints(self) -> tuple[int, ...]:
        """The joints of waist and arms."""
        return tuple(i for i, joint in enumerate(self.joints) if joint.kind not in self.legs)

    def bodies(self, names: Iterable[str]) -> tuple[int, ...]:
        """Indices of tracked bodies by their names."""
        return tuple(self.tracked_bodies.index(name) for name in names)

    def arm(self, side: str) -> tuple[int, ...]:
        """The joints of the arm of that side."""
        return tuple(i for i, j in enumerate(self.joints) if j.side == side and j.kind in self.arms)

    @cached_property
    def gain_sets(self) -> tuple[str, ...]:
        return tuple(self.joints[0].gains)

    @cached_property
    def joint_range_rad(self) -> np.ndarray:
        """Lower and upper limit of each joint, float64 [num_joints, 2]."""
        return np.array([joint.range for joint in self.joints])

    def joint_tables(self, gains: str) -> dict[str, np.ndarray]:
        """The columns of the joints' table under one set of gains.

        Returns:
            Float64 arrays of ``num_joints`` rows, named as the fields of
            ``tlr_exp.robot.model.Robot``.
        """
        control = [joint.gains[gains] for joint in self.joints]
        columns = {
            "effort_limit_nm": [joint.effort for joint in self.joints],
            "velocity_limit_rad_s": [joint.velocity for joint in self.joints],
            "default_joint_pos_rad": [each.default_pos for each in control],
            "action_scale_rad": [each.action_scale for each in control],
            "kp": [each.kp for each in control],
            "kd": [each.kd for each in control],
            "armature": [each.armature for each in control],
        }
        arrays = {name: np.array(values, dtype=np.float64) for name, values in columns.items()}
        return {"joint_range_rad": self.joint_range_rad, **arrays}
