"""A script sampled at its frames: feet, contacts, what the floor and the legs allow."""

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from tlr_exp.motion.authoring.balance import GRAVITY, MassEstimate, Support, plan_height
from tlr_exp.motion.authoring.flight import flights, momentum_turn
from tlr_exp.motion.authoring.script import Script
from tlr_exp.motion.authoring.splines import bump, interpolate
from tlr_exp.motion.clip import MotionClip
from tlr_exp.motion.feet import half_planes, hip_offset, sole_points
from tlr_exp.motion.quaternions import from_euler, rotate
from tlr_exp.robot.model import Robot
from tlr_exp.robot.spec import SIDES

# Joints keep this far from their limits, so that a controller has room on both sides.
LIMIT_MARGIN_RAD = 0.05
_NOTHING = 1e-9
_HANGING_M = 0.04  # a foot this high above the floor need no longer be parallel to it


@dataclass(frozen=True)
class FootPath:
    """The way of one foot.

    Attributes:
        place: [T, 3], the point of the sole below the ankle, in metres.
        yaw, pitch: [T], radians.
        hanging: [T], from 0 on the floor to 1 where the foot is well above it.
        on_floor: [T], whether the foot carries weight.
    """

    place: np.ndarray
    yaw: np.ndarray
    pitch: np.ndarray
    hanging: np.ndarray
    on_floor: np.ndarray


@dataclass(frozen=True)
class BodyTargets:
    """What inverse kinematics must meet, one row a frame; world frame, metres, wxyz.

    Attributes:
        times_s: [T].
        com_xy: [T, 2], centre of mass over the floor.
        pelvis_height: [T].
        pelvis_quat: [T, 4].
        foot_pos: [2, T, 3], origins of the ankle roll links, left and right.
        foot_quat: [2, T, 4].
        joint_pos: [T, 23], of which those of waist and arms are taken.
        com_height: [T], to be met in place of ``pelvis_height`` where it is not a draft; or None.
    """

    times_s: np.ndarray
    com_xy: np.ndarray
    pelvis_height: np.ndarray
    pelvis_quat: np.ndarray
    foot_pos: np.ndarray
    foot_quat: np.ndarray
    joint_pos: np.ndarray
    com_height: np.ndarray | None = None


class MotionPlan:
    """What a script asks of the body, frame by frame.

    Attributes:
        fps: frames a second.
        names: keyframe names and their times in seconds.
        times_s: [T].
        pelvis_height_m: [T].
        pelvis_quat: [T, 4].
        joint_pos: [T, 23], of which waist and arms are given, the legs zero.
        feet: the two feet's paths.
        flights: take-off and landing frames.
        com_height_m: [T] where there are flights, else None.
    """

    def __init__(self, script: Script, robot: Robot) -> None:
        self.fps, self.names = script.fps, dict(script.names)
        frames = round(script.duration_s * script.fps) + 1
        self.times_s = np.arange(frames) / script.fps
        channels = {name: interpolate(knots, self.times_s) for name, knots in script.knots.items()}
        self.pelvis_height_m = self._written_height_m = channels["pelvis.height_m"]
        angles = (channels[f"pelvis.{key}"] for key in ("yaw", "pitch", "roll"))
        self.pelvis_quat = self._written_quat = from_euler(*angles)
        self.turn = np.zeros((frames, 3))
        self.joint_pos = np.zeros((frames, robot.spec.num_joints))
        for i, name in enumerate(robot.spec.joint_names):
            if name in channels:
                self.joint_pos[:, i] = channels[name]
        self.feet = [_foot_path(script, channels, side, self.times_s) for side in SIDES]
        self.flights = flights(np.stack([foot.on_floor for foot in self.feet]), self.times_s)
        self.com_height_m: np.ndarray | None = None
        self._weight_on_right = channels["weight_on_right"]
        self._soles = [sole_points(robot, side) for side in range(len(SIDES))]
        self._hips = [hip_offset(robot, side) for side in range(len(SIDES))]
        self._ankle_room = [_ankle_room(robot, side) for side in range(len(SIDES))]

    def fall_freely(self, mass: MassEstimate) -> MassEstimate:
        """Let the centre of mass fall freely while both feet are in the air.

        Its heights at take-off and landing and the time between them settle the flight; heights
        that the script gives in between are passed over, and those shortly before and after may
        be missed by some centimetres.

        Returns:
            ``mass`` with the height and the load of this plan.
        """
        if not self.flights:
            return mass
        above = mass.pelvis_offset[:, 2]
        height, lift = plan_height(self._written_height_m - above, self.flights, self.times_s)
        self.com_height_m, self.pelvis_height_m = height, height + above
        return replace(mass, height=height, load=1 + lift / GRAVITY)

    def keep_momentum(self, clip: MotionClip, robot: Robot) -> None:
        """Turn the pelvis so that flights keep angular momentum; ``clip`` came of the last turn."""
        if not self.flights:
            return
        self.turn = momentum_turn(clip, robot, self.flights, self.turn)
        written = Rotation.from_quat(self._written_quat, scalar_first=True)
        self.pelvis_quat = (Rotation.from_rotvec(self.turn) * written).as_quat(scalar_first=True)

    def support(self, pelvis_offset_m: np.ndarray) -> Support:
        """The constraints on the centre of mass.

        Args:
            pelvis_offset_m: [T, 3], from the centre of mass to the pelvis.
        """
        on_floor = np.stack([foot.on_floor for foot in self.feet])
        share = np.stack([1 - self._weight_on_right, self._weight_on_right])
        share = np.where(on_floor.all(axis=0) | ~on_floor.any(axis=0), share, on_floor)
        soles = [self._sole(side) for side in range(len(SIDES))]
        middles = np.stack([(s.min(axis=1) + s.max(axis=1)) / 2 for s in soles])  # [2, T, 2]
        planes, reach = [], []
        for t in range(len(self.times_s)):
            standing = [side for side in range(len(SIDES)) if on_floor[side, t]]
            touching = [soles[side][t] for side in standing]
            planes.append(half_planes(np.concatenate(touching)) if touching else None)
            rows = [self._reach(side, t, pelvis_offset_m[t, :2]) for side in range(len(SIDES))]
            reach.append(np.concatenate(rows))
        target = np.sum(share[..., None] * middles, axis=0)
        return Support(planes, target, reach, self.flights)

    def targets(self, com: np.ndarray, pelvis_offset_m: np.ndarray) -> BodyTargets:
        """What inverse kinematics must meet.

        Args:
            com: [T, 2], the planned centre of mass.
            pelvis_offset_m: [T, 3], from there about to the pelvis.
        """
        pelvis_xy = com + pelvis_offset_m[:, :2]
        poses = [self._ankle(side, pelvis_xy) for side in range(len(SIDES))]
        return BodyTargets(
            times_s=self.times_s,
            com_xy=com,
            pelvis_height=self.pelvis_height_m,
            com_height=self.com_height_m,
            pelvis_quat=self.pelvis_quat,
            foot_pos=np.stack([position for position, _ in poses]),
            foot_quat=np.stack([quat for _, quat in poses]),
            joint_pos=self.joint_pos,
        )

    def _sole(self, side: int) -> np.ndarray:
        """The flat sole's points over the floor, [T, n, 2]."""
        foot = self.feet[side]
        yaw = from_euler(foot.yaw, 0 * foot.yaw, 0 * foot.yaw)
        return (rotate(yaw[:, None], self._soles[side]) + foot.place[:, None])[..., :2]

    def _lean(self, side: int, pelvis_xy: np.ndarray) -> np.ndarray:
        """Sideways angle [T] of the leg, seen along the foot; 0 where the hip is above it."""
        foot, hip = self.feet[side], rotate(self.pelvis_quat, self._hips[side])
        across = np.stack([-np.sin(foot.yaw), np.cos(foot.yaw)], axis=1)
        aside = np.sum(across * (foot.place[:, :2] - pelvis_xy - hip[:, :2]), axis=1)
        return np.arctan2(aside, self._leg_height(side))

    def _leg_height(self, side: int) -> np.ndarray:
        """Height [T] of the hip above the ankle."""
        hip = self.pelvis_height_m + rotate(self.pelvis_quat, self._hips[side])[:, 2]
        return hip - self.feet[side].place[:, 2] + self._soles[side][:, 2].min()

    def _ankle(self, side: int, pelvis_xy: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Pose of an ankle roll link: position [T, 3] and orientation [T, 4].

        Above the floor the foot hangs at right angles to its shin, because the ankle has little
        room to roll: a flat foot would limit how far the leg can go to the side.
        """
        foot = self.feet[side]
        quat = from_euler(foot.yaw, foot.pitch, foot.hanging * self._lean(side, pelvis_xy))
        up = np.array([0.0, 0.0, -self._soles[side][:, 2].min()])
        return foot.place + rotate(quat, up), quat

    def _reach(self, side: int, t: int, pelvis_offset_m: np.ndarray) -> np.ndarray:
        """Half-planes [n, 3] on the centre of mass within which the ankle's roll suffices."""
        foot = self.feet[side]
        flat = 1 - foot.hanging[t]
        if flat * np.pi / 2 <= self._ankle_room[side]:
            return np.empty((0, 3))
        across = np.array([-np.sin(foot.yaw[t]), np.cos(foot.yaw[t])])
        hip = rotate(self.pelvis_quat[t], self._hips[side])[:2] + pelvis_offset_m
        middle = across @ (foot.place[t, :2] - hip)
        room = self._leg_height(side)[t] * np.tan(self._ankle_room[side] / flat)
        return np.array([[*across, -middle - room], [*-across, middle - room]])


def _foot_path(
    script: Script, channels: dict[str, np.ndarray], side: str, times_s: np.ndarray
) -> FootPath:
    place = np.stack([channels[f"{side}_foot.{key}"] for key in ("x_m", "y_m", "z_m")], axis=1)
    on_floor = place[:, 2] < _NOTHING
    for swing in script.swings[side]:
        place[:, 2] += swing.lift_m * bump(swing.start_s, swing.end_s, times_s)
        # At the moments at which it leaves and arrives a foot still carries weight.
        after, before = times_s > swing.start_s + _NOTHING, times_s < swing.end_s - _NOTHING
        on_floor &= ~(after & before)
    yaw, pitch = channels[f"{side}_foot.yaw"], channels[f"{side}_foot.pitch"]
    hanging = 1 - (1 - np.clip(place[:, 2] / _HANGING_M, 0, 1)) ** 3
    return FootPath(place, yaw, pitch, hanging, on_floor)


def _ankle_room(robot: Robot, side: int) -> float:
    """How far an ankle may roll either way, in radians."""
    joint = robot.spec.link_names.index(robot.spec.foot_names[side]) - 1  # the pelvis has none
    return float(np.abs(robot.joint_range_rad[joint]).min()) - LIMIT_MARGIN_RAD
