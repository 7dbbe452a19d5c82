"""Inverse kinematics: joint angles that put the body where the plan wants it (mink, DAQP)."""

import mujoco
import numpy as np
from scipy.optimize import least_squares

from tlr_exp.errors import UserError
from tlr_exp.motion.authoring.mink_alone import mink
from tlr_exp.motion.authoring.plan import LIMIT_MARGIN_RAD, BodyTargets
from tlr_exp.motion.checks import QPOS_JOINTS, ROOT_QUAT
from tlr_exp.robot.model import Robot
from tlr_exp.robot.spec import SIDES

_STEP_TOLERANCE = 1e-7  # rad and m; the last step of Newton's method is smaller
_MAX_STEPS = 40
_REACH_M = 1e-3  # what a foot or the centre of mass may miss
_DRAFT_REACH_M = 0.03  # likewise in a draft, whose plan does not yet know the limbs
_HAND_REACH_M = 0.01


class _HeightTask(mink.Task):
    """Keeps the height of the free joint; a frame task would do so along the tilted pelvis."""

    def __init__(self, cost: float) -> None:
        super().__init__(cost=np.array([cost]))
        self.target = 0.0

    def compute_error(self, configuration: mink.Configuration) -> np.ndarray:
        return configuration.q[2:3] - self.target

    def compute_jacobian(self, configuration: mink.Configuration) -> np.ndarray:
        return np.eye(1, configuration.nv, 2)


class BodySolver:
    """Finds a configuration for each frame, starting from that of the frame before.

    Feet, pelvis, centre of mass and the angles of waist and arms fix every degree of freedom, so
    that the solution is smooth where the targets are.
    """

    def __init__(self, robot: Robot) -> None:
        model, self.spec = robot.model, robot.spec
        self.configuration = mink.Configuration(model)
        self.feet = [mink.FrameTask(name, "body", 10.0, 10.0) for name in self.spec.foot_names]
        self.pelvis = mink.FrameTask(self.spec.pelvis_name, "body", 0.0, 3.0)
        self.height = _HeightTask(3.0)
        self.com = mink.ComTask([1.0, 1.0, 0.0])
        self.falls = False  # whether the height of the centre of mass is held, not the pelvis's
        held = np.zeros(self.spec.num_qvel)
        held[[6 + i for i in self.spec.upper_joints]] = 3.0
        self.posture = mink.PostureTask(model, held)
        self.limits = {
            strict: [mink.ConfigurationLimit(model, 1.0, LIMIT_MARGIN_RAD if strict else 0.0)]
            for strict in (False, True)
        }
        self.tasks = [*self.feet, self.pelvis, self.height, self.com, self.posture]

    def solve(self, targets: BodyTargets, strict: bool = True) -> np.ndarray:
        """Configurations [T, 30] that meet the targets.

        Without ``strict`` they are a draft: joints may go up to their limits, and targets may be
        missed by centimetres.

        Raises:
            ValueError: a foot or the centre of mass cannot get where it should; the message
                gives the time, the distance and the joints that are at their limits.
        """
        frames = len(targets.pelvis_height)
        # A draft does not know well how high the pelvis is above the centre of mass.
        self.falls = strict and targets.com_height is not None
        self.com.set_cost([1.0, 1.0, 1.0 if self.falls else 0.0])
        self.height.cost[:] = 0.0 if self.falls else 3.0
        qpos = np.empty((frames, self.spec.num_qpos))
        start = np.zeros(self.spec.num_qpos)
        start[:2], start[2] = targets.com_xy[0], targets.pelvis_height[0]
        start[ROOT_QUAT] = targets.pelvis_quat[0]
        start[QPOS_JOINTS] = self.spec.stance.joint_pos_rad
        self.configuration.update(start)
        for t in range(frames):
            self._aim(targets, t)
            self._converge(strict)
            self._check_reached(targets.times_s[t], _REACH_M if strict else _DRAFT_REACH_M)
            qpos[t] = self.configuration.q
        return qpos

    def _aim(self, targets: BodyTargets, t: int) -> None:
        for side, foot in enumerate(self.feet):
            foot.set_target(_pose(targets.foot_quat[side, t], targets.foot_pos[side, t]))
        self.pelvis.set_target(_pose(targets.pelvis_quat[t], np.zeros(3)))
        self.height.target = targets.pelvis_height[t]
        height = 0.0 if targets.com_height is None else targets.com_height[t]
        self.com.set_target(np.append(targets.com_xy[t], height))
        posture = np.zeros(self.spec.num_qpos)
        posture[3] = 1.0
        posture[QPOS_JOINTS] = targets.joint_pos[t]
        self.posture.set_target(posture)

    def _converge(self, strict: bool) -> None:
        for _ in range(_MAX_STEPS):
            step = mink.solve_ik(
                self.configuration,
                self.tasks,
                1.0,
                "daqp",
                damping=1e-9,
                limits=self.limits[strict],
            )
            self.configuration.integrate_inplace(step, 1.0)
            if np.abs(step).max() < _STEP_TOLERANCE:
                return

    def _check_reached(self, time_s: float, reach_m: float) -> None:
        misses = {
            f"the {name}": np.linalg.norm(foot.compute_error(self.configuration))
            for name, foot in zip(("left foot", "right foot"), self.feet, strict=True)
        }
        miss = self.com.compute_error(self.configuration)
        misses["the centre of mass"] = np.linalg.norm(miss if self.falls else miss[:2])
        if not self.falls:
            misses["the pelvis"] = abs(self.height.compute_error(self.configuration)[0])
        worst = max(misses, key=lambda what: misses[what])
        if misses[worst] > reach_m:
            raise UserError(
                f"at {time_s:.2f} s {worst} misses its target by {1000 * misses[worst]:.0f} mm; "
                f"joints at their limits: {', '.join(self._blocked()) or '(none)'}"
            )

    def _blocked(self) -> list[str]:
        joints = self.configuration.q[QPOS_JOINTS]
        low, high = self.configuration.model.jnt_range[1:].T
        room = np.minimum(joints - low, high - joints)
        names = zip(self.spec.joint_names, room, strict=True)
        return [name for name, gap in names if gap < LIMIT_MARGIN_RAD + 1e-3]


class HandSolver:
    """Joint angles of one arm that bring its hand to a place given in the torso's frame."""

    def __init__(self, robot: Robot) -> None:
        self.model, self.data = robot.model, mujoco.MjData(robot.model)
        self.spec = robot.spec

    def __call__(self, side: str, target_m: list[float], start: list[float]) -> list[float]:
        """Angles [4] in radians, near ``start`` where the hand leaves a choice.

        Raises:
            ValueError: the arm cannot reach the target.
        """
        joints = list(self.spec.arm(side))
        low, high = self.spec.joint_range_rad[joints].T
        low, high = low + LIMIT_MARGIN_RAD, high - LIMIT_MARGIN_RAD
        begin = np.clip(start, low + 1e-3, high - 1e-3)

        def residual(angles: np.ndarray) -> np.ndarray:
            miss = self._hand(side, joints, angles) - target_m
            return np.concatenate([miss, 0.01 * (angles - begin)])

        angles = least_squares(residual, begin, bounds=(low, high)).x
        miss = float(np.linalg.norm(self._hand(side, joints, angles) - target_m))
        if miss > _HAND_REACH_M:
            raise UserError(f"the {side} hand misses {target_m} by {1000 * miss:.0f} mm")
        return [float(angle) for angle in angles]

    def _hand(self, side: str, joints: list[int], angles: np.ndarray) -> np.ndarray:
        self.data.qpos[:] = 0.0
        self.data.qpos[3] = 1.0
        self.data.qpos[[7 + i for i in joints]] = angles
        mujoco.mj_kinematics(self.model, self.data)
        torso = self.data.body(self.spec.torso_name)
        hand = self.spec.hand_names[SIDES.index(side)]
        offset = self.data.body(hand).xpos - torso.xpos
        return torso.xmat.reshape(3, 3).T @ offset


def _pose(quat: np.ndarray, position: np.ndarray) -> mink.SE3:
    return mink.SE3(np.concatenate([quat, position]))
