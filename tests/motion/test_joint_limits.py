"""Joint limits: distances by hand, and clamping that changes nothing else."""

import numpy as np
import pytest

from tlr_exp.motion.joint_limits import beyond_limits, clamp_joints, furthest_beyond
from tlr_exp.robot.g1 import G1

RANGE = np.tile([-1.0, 2.0], (23, 1))


def test_distances_to_the_nearer_limit():
    joints = np.zeros((1, 23))
    joints[0, :5] = [-1.5, -1.0, 0.0, 1.75, 2.5]
    assert beyond_limits(joints, RANGE)[0, :5].tolist() == [0.5, 0.0, -1.0, -0.25, 0.5]


def test_the_worst_is_named():
    joints = np.zeros((3, 23))
    joints[1, 3], joints[2, 0] = -0.0873 - 0.25, 2.8798 + 0.125
    beyond, words = furthest_beyond(joints, G1)
    assert beyond == pytest.approx(0.25)
    assert words == "left_knee_joint is -0.337 rad at frame 1; its range is [-0.087, 2.880] rad"


def test_clamping_leaves_the_root_and_what_is_inside(swaying_qpos):
    clamped = clamp_joints(swaying_qpos, np.tile([-0.1, 0.1], (23, 1)))
    np.testing.assert_array_equal(clamped[:, :7], swaying_qpos[:, :7])
    inside = np.abs(swaying_qpos[:, 7:]) <= 0.1
    assert 0 < inside.sum() < inside.size
    np.testing.assert_array_equal(clamped[:, 7:][inside], swaying_qpos[:, 7:][inside])
    assert np.abs(clamped[:, 7:][~inside]) == pytest.approx(0.1)
