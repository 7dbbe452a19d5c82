"""Trajectories made by hand."""

import numpy as np

from tlr_exp.evaluation.trajectory import Trajectory
from tlr_exp.robot.g1 import G1

DT = 0.02


def trajectory_of(
    qpos: np.ndarray,
    reference_qpos: np.ndarray,
    body_pos_w: np.ndarray,
    reference_body_pos_w: np.ndarray,
) -> Trajectory:
    """A trajectory of these positions: no velocity, torque or instability, one reward term."""
    num_steps = len(qpos)
    return Trajectory(
        spec=G1,
        control_dt_s=DT,
        qpos=qpos,
        reference_qpos=reference_qpos,
        qvel=np.zeros((num_steps, 29)),
        reference_qvel=np.zeros((num_steps, 29)),
        joint_torque=np.zeros((num_steps, G1.num_joints)),
        body_pos_w=body_pos_w,
        reference_body_pos_w=reference_body_pos_w,
        terms={"body_pos": np.ones(num_steps)},
        unstable=np.zeros(num_steps, dtype=bool),
    )


def upright(num_steps: int) -> np.ndarray:
    """Poses [T, 30] of a robot that stands upright in the origin, all joints at 0."""
    qpos = np.zeros((num_steps, 30))
    qpos[:, 3] = 1.0
    return qpos


def still_trajectory(num_steps: int = 100) -> Trajectory:
    """A robot that stands upright on its reference, all bodies in the origin."""
    bodies = np.zeros((num_steps, len(G1.tracked_bodies), 3))
    made = trajectory_of(upright(num_steps), upright(num_steps), bodies, bodies.copy())
    made.terms["base_height"] = np.linspace(0.0, 1.0, num_steps)
    made.terms["body_pos"] = np.full(num_steps, 0.75)
    return made
