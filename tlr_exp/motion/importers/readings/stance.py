"""Measures how a robot is there in a motion: on the floor or not, upright or not, how fast."""

from dataclasses import dataclass

import mujoco
import numpy as np

from tlr_exp.motion.checks import QPOS_JOINTS
from tlr_exp.motion.feet import sole_points
from tlr_exp.motion.importers.raw import Bodies, RawMotion
from tlr_exp.motion.importers.readings.kinematics import distances
from tlr_exp.motion.joint_limits import beyond_limits
from tlr_exp.motion.quaternions import rotate
from tlr_exp.robot.model import Robot
from tlr_exp.robot.spec import SIDES

FRAMES = 25  # looked at, evenly over the motion
# Beyond these nothing is a motion on a floor at z = 0: a tenth of the frames deeper, half of them
# higher, the torso upside down in half of them, 5 % of the steps faster than any sprint.
UNDER_FLOOR_M, OVER_FLOOR_M = 0.3, 0.4
UPSIDE_DOWN = -0.5
SPEED_M_S = 10.0
# A robot that stands upright on the floor, as nearly all motions do in most of their frames.
UPRIGHT, ON_FLOOR_M, SPREAD_M = 0.8, 0.2, 0.5

_Z = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True)
class Stance:
    """How the robot is there: medians over the frames, unless stated.

    Attributes:
        lowest_m: height of its lowest point.
        low_m, high_m: what 10 % of these heights are below, and above.
        up: the z component of the torso's axis: 1 upright, -1 upside down.
        tilt_rad: angle of the lower sole against the floor.
        speed_m_s: of the pelvis, what 5 % of its steps are faster than.
        beyond_rad: how far the worst joint is beyond its limit.
        gap_m: mean distance of the file's bodies from where its joints put them; 0 without bodies.
    """

    lowest_m: float
    low_m: float
    high_m: float
    up: float
    tilt_rad: float
    speed_m_s: float
    beyond_rad: float
    gap_m: float

    @property
    def fault(self) -> str:
        """What cannot be, in words; empty if all can."""
        if self.speed_m_s > SPEED_M_S:
            return f"the pelvis moves at {self.speed_m_s:.3g} m/s"
        if self.lowest_m > OVER_FLOOR_M:
            return f"the lowest point of the robot is {self.lowest_m:.3g} m over the floor"
        if self.low_m < -UNDER_FLOOR_M:
            return f"the lowest point of the robot is {-self.low_m:.3g} m under the floor"
        if self.up < UPSIDE_DOWN:
            return "the robot is upside down"
        return ""

    @property
    def stands(self) -> bool:
        """Upright on the floor."""
        on_floor = abs(self.lowest_m) < ON_FLOOR_M and self.high_m - self.low_m < SPREAD_M
        return not self.fault and self.up > UPRIGHT and on_floor

    @property
    def badness(self) -> float:
        """By how much it stands less well than with flat soles on the floor all the time."""
        return self.tilt_rad + 2 * abs(self.lowest_m) + 2 * (self.high_m - self.low_m)


class StanceMeter:
    """Measures motions of one robot.

    Raises:
        ValueError: as ``sole_points``.
    """

    def __init__(self, robot: Robot) -> None:
        self._robot = robot
        self._data = mujoco.MjData(robot.model)
        self._soles = [sole_points(robot, side) for side in range(len(SIDES))]

    def measure(self, raw: RawMotion) -> Stance:
        """Look at a motion in some of its frames, at its speed and its joints in all."""
        rows = np.unique(np.linspace(0, len(raw.qpos) - 1, FRAMES).round().astype(int))
        pos, quat = self._poses(raw.qpos[rows])
        spec = self._robot.spec
        torso = spec.tracked_bodies.index(spec.torso_name)
        gap = 0.0
        if raw.bodies is not None:
            gap = float(
                distances(pos, Bodies(raw.bodies.names, raw.bodies.pos_w[rows]), spec).mean()
            )
        heights = [
            (pos[:, None, foot] + rotate(quat[:, None, foot], sole[None]))[..., 2].min(axis=1)
            for foot, sole in zip(spec.feet, self._soles, strict=True)
        ]
        lowest = np.minimum(np.minimum(*heights), pos[..., 2].min(axis=1))
        axes = rotate(quat[:, spec.feet], _Z)[..., 2]
        lower = np.where(heights[0] < heights[1], axes[:, 0], axes[:, 1])
        steps = np.linalg.norm(np.diff(raw.qpos[:, :3], axis=0), axis=1) * raw.fps
        low, high = np.percentile(lowest, [10, 90])
        joints = raw.qpos[:, QPOS_JOINTS]
        return Stance(
            lowest_m=float(np.median(lowest)),
            low_m=float(low),
            high_m=float(high),
            up=float(np.median(rotate(quat[:, torso], _Z)[:, 2])),
            tilt_rad=float(np.median(np.arccos(np.clip(lower, -1, 1)))),
            speed_m_s=float(np.percentile(steps, 95)),
            beyond_rad=float(beyond_limits(joints, self._robot.joint_range_rad).max()),
            gap_m=gap,
        )

    def _poses(self, qpos: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Positions [T, 27, 3] and quaternions [T, 27, 4] of the tracked bodies."""
        model, data, ids = self._robot.model, self._data, self._robot.body_ids
        pos, quat = np.empty((len(qpos), len(ids), 3)), np.empty((len(qpos), len(ids), 4))
        for t, row in enumerate(qpos):
            data.qpos[:] = row
            mujoco.mj_kinematics(model, data)
            pos[t], quat[t] = data.xpos[ids], data.xquat[ids]
        return pos, quat
