"""Distances in the world and from the pelvis, by hand and against SciPy's rotations."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from tlr_exp.evaluation.distances import body_distance, heading, seen_from_the_pelvis, tilt
from tlr_exp.robot.g1 import G1


def quat(axis: tuple[float, float, float], angle_rad: float) -> np.ndarray:
    """Unit quaternion wxyz, [1, 4]."""
    x, y, z, w = Rotation.from_rotvec(angle_rad * np.array(axis)).as_quat()
    return np.array([[w, x, y, z]])


def bodies(seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).uniform(-1.0, 1.0, (1, len(G1.tracked_bodies), 3))


def test_body_distance_is_euclidean():
    here = np.zeros((1, 2, 3))
    there = np.array([[[0.3, 0.4, 0.0], [0.0, 0.0, -2.0]]])
    np.testing.assert_allclose(body_distance(here, there), [[0.5, 2.0]])


def test_from_a_pelvis_that_faces_left_what_is_to_the_left_is_ahead():
    there = np.zeros((1, len(G1.tracked_bodies), 3))
    there[0, :] = [5.0, 0.0, 0.8]
    there[0, G1.pelvis + 1] = [5.0, 0.3, 0.9]  # 0.3 m in the direction of y, 0.1 m higher
    seen = seen_from_the_pelvis(there, G1.pelvis, quat((0, 0, 1), math.pi / 2))
    np.testing.assert_allclose(seen[0, G1.pelvis + 1], [0.3, 0.0, 0.1], atol=1e-12)
    np.testing.assert_allclose(seen[0, G1.pelvis], 0.0, atol=1e-12)


@settings(deadline=None)
@given(st.floats(-math.pi, math.pi), *[st.floats(-50.0, 50.0)] * 3, st.floats(-0.6, 0.6))
def test_a_motion_that_is_shifted_and_turned_looks_the_same(turn, x, y, z, lean):
    before, pose = bodies(), quat((0, 1, 0), lean)
    rotation = Rotation.from_rotvec([0.0, 0.0, turn])
    after = rotation.apply(before[0])[None] + np.array([x, y, z])
    w, rx, ry, rz = pose[0]
    turned = (rotation * Rotation.from_quat([rx, ry, rz, w])).as_quat()[[3, 0, 1, 2]][None]
    seen = seen_from_the_pelvis(before, G1.pelvis, pose)
    np.testing.assert_allclose(seen_from_the_pelvis(after, G1.pelvis, turned), seen, atol=1e-10)


def test_a_robot_that_leans_does_not_look_the_same():
    before = bodies()
    rotation = Rotation.from_rotvec([0.3, 0.0, 0.0])
    after = rotation.apply(before[0])[None]
    seen = seen_from_the_pelvis(after, G1.pelvis, quat((1, 0, 0), 0.3))
    assert np.abs(seen - seen_from_the_pelvis(before, G1.pelvis, quat((1, 0, 0), 0.0))).max() > 0.1


@pytest.mark.parametrize("angle_rad", [-3.0, -0.5, 0.0, 1.0, 3.1])
def test_heading_is_the_yaw_of_a_level_robot(angle_rad):
    assert heading(quat((0, 0, 1), angle_rad))[0] == pytest.approx(angle_rad)


@pytest.mark.parametrize(
    ("axis", "angle_deg"), [((1, 0, 0), 30), ((0, 1, 0), 30), ((0, 1, 0), -30)]
)
def test_tilt_is_the_sine_of_roll_or_pitch(axis, angle_deg):
    assert tilt(quat(axis, math.radians(angle_deg)))[0] == pytest.approx(0.5)


def test_tilt_ignores_heading():
    half = np.linspace(-np.pi, np.pi, 9) / 2
    zero = np.zeros(9)
    assert tilt(np.stack([np.cos(half), zero, zero, np.sin(half)], axis=1)) == pytest.approx(zero)
