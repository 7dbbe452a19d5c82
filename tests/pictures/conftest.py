"""What pictures are tested with: whether this machine can draw, and two roll-outs."""

import dataclasses

import numpy as np
import pytest
from trajectories import trajectory_of

from tlr_exp.evaluation.trajectory import Trajectory
from tlr_exp.pictures.graphics import GraphicsUnavailable, graphics_backend
from tlr_exp.robot.g1 import G1

STEPS = 30
FALL = 12  # the first step of the falling robot that counts as fallen
LYING = (np.cos(np.pi / 4), 0.0, np.sin(np.pi / 4), 0.0)  # a quarter turn about y: on its face


@pytest.fixture(scope="session")
def can_draw() -> None:
    try:
        graphics_backend()
    except GraphicsUnavailable as error:
        pytest.skip(str(error))


@pytest.fixture(scope="module")
def standing(short_clip) -> Trajectory:
    """30 steps of the short motion, tracked exactly but for the left elbow, 0.1 rad off."""
    qpos = short_clip.qpos[:STEPS].copy()
    qpos[:, 7 + G1.joint_names.index("left_elbow_joint")] += 0.1
    bodies = short_clip.body_pos_w[:STEPS]
    return trajectory_of(qpos, short_clip.qpos[:STEPS].copy(), bodies.copy(), bodies.copy())


@pytest.fixture(scope="module")
def falling(standing) -> Trajectory:
    """The same until step 12; from there on the robot lies 0.6 m below where it should be."""
    qpos, bodies = standing.qpos.copy(), standing.body_pos_w.copy()
    qpos[FALL:, 2] -= 0.6
    qpos[FALL:, 3:7] = LYING
    bodies[FALL:, :, 2] -= 0.6
    return dataclasses.replace(standing, qpos=qpos, body_pos_w=bodies)
