"""Computes what a clip asks of the real robot: balance, joint torques, the floor's forces."""

from dataclasses import dataclass

import mujoco
import numpy as np
from scipy.optimize import nnls

from tlr_exp.motion.clip import MotionClip
from tlr_exp.motion.feet import sole_points
from tlr_exp.robot.model import Robot

FRICTION = 0.6
_CONTACT_M = 0.003  # a sole's point this close to the floor carries weight


@dataclass(frozen=True)
class Centroidal:
    """Centre of mass and angular momentum about it, world frame, [T, 3] each; mass in kg."""

    com: np.ndarray
    com_vel: np.ndarray
    angular_momentum: np.ndarray
    mass: float


@dataclass(frozen=True)
class Effort:
    """Inverse dynamics of a clip, one row a frame.

    Attributes:
        joint_torque: [T, 23], N m.
        foot_force: [T, 2], N, upward force of the floor on the left and right foot.
        unmet_force: [T], the part of the needed force and torque on the pelvis (N and N m, norm)
            that no push of the floor within friction can give. It is zero for a motion that the
            robot can do, and in flight where it falls freely.
    """

    joint_torque: np.ndarray
    foot_force: np.ndarray
    unmet_force: np.ndarray


def centroidal(clip: MotionClip, robot: Robot) -> Centroidal:
    """Centre of mass and momentum of each frame."""
    model, data = robot.model, mujoco.MjData(robot.model)
    com, velocity, momentum = (np.empty((clip.num_frames, 3)) for _ in range(3))
    root = robot.pelvis_id
    for t in range(clip.num_frames):
        data.qpos[:], data.qvel[:] = clip.qpos[t], clip.qvel[t]
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_comVel(model, data)
        mujoco.mj_subtreeVel(model, data)
        com[t] = data.subtree_com[root]
        velocity[t] = data.subtree_linvel[root]
        momentum[t] = data.subtree_angmom[root]
    return Centroidal(com, velocity, momentum, float(model.body_subtreemass[root]))


def inverse_dynamics(clip: MotionClip, robot: Robot) -> Effort:
    """Torques and floor forces that move the robot as the clip does.

    The forces act at the points of the soles that touch the floor, and are the smallest within
    friction pyramids that hold the pelvis (nonnegative least squares).
    """
    model, data = robot.model, mujoco.MjData(robot.model)
    soles = [sole_points(robot, side) for side in range(2)]
    qacc = np.gradient(clip.qvel, 1 / clip.fps, axis=0)
    torque, vertical = np.empty((clip.num_frames, model.nv - 6)), np.zeros((clip.num_frames, 2))
    unmet = np.empty(clip.num_frames)
    for t in range(clip.num_frames):
        data.qpos[:], data.qvel[:], data.qacc[:] = clip.qpos[t], clip.qvel[t], qacc[t]
        needed = _needed_force(model, data)
        edges, sides = _contact_edges(robot, data, soles)
        strength = _push(edges, needed)
        rest = needed - strength @ edges
        torque[t], unmet[t] = rest[6:], np.linalg.norm(rest[:6])
        vertical[t] = [strength[sides == side].sum() for side in range(2)]
    return Effort(torque, vertical, unmet)


def _needed_force(model: mujoco.MjModel, data: mujoco.MjData) -> np.ndarray:
    """Generalised forces [29] of the motion in ``data``, as if nothing touched the robot."""
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    mujoco.mj_comVel(model, data)
    force = np.zeros(model.nv)
    mujoco.mj_rne(model, data, 1, force)
    return force + model.dof_armature * data.qacc


def _push(edges: np.ndarray, needed: np.ndarray) -> np.ndarray:
    """How strongly [n] to push along each of ``edges`` to give the pelvis what it needs."""
    if not len(edges):
        return np.empty(0)
    # A trace of regularisation shares the load among points that could swap it.
    system = np.vstack([edges[:, :6].T, 1e-3 * np.eye(len(edges))])
    return nnls(system, np.concatenate([needed[:6], np.zeros(len(edges))]))[0]


def _contact_edges(
    robot: Robot, data: mujoco.MjData, soles: list[np.ndarray]
) -> tuple[np.ndarray, np.ndarray]:
    """Generalised forces [n, 29] of unit pushes along friction pyramids, and their feet [n]."""
    rows, sides = [np.empty((0, robot.model.nv))], []
    pyramid = FRICTION * np.array([[1, 0], [-1, 0], [0, 1], [0, -1]])
    pushes = np.hstack([pyramid, np.ones((4, 1))])
    for side, body in enumerate(robot.foot_body_ids):
        points = data.xpos[body] + soles[side] @ data.xmat[body].reshape(3, 3).T
        for point in points[points[:, 2] < _CONTACT_M]:
            jacobian = np.zeros((3, robot.model.nv))
            mujoco.mj_jac(robot.model, data, jacobian, None, point, body)
            rows.append(pushes @ jacobian)
            sides += [side] * len(pushes)
    return np.concatenate(rows), np.array(sides, dtype=int)
