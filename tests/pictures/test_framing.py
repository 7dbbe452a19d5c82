"""Where the camera is and looks: along with the robot, far enough for all, not down with a fall."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tlr_exp.motion.clip import clip_from_qpos
from tlr_exp.pictures.framing import (
    FARTHEST_M,
    camera_path,
    fitting_distance,
    follow_pelvis,
    frame_robots,
)
from tlr_exp.pictures.recording import recording_of_clip, recording_of_trajectory


@settings(deadline=None, max_examples=30)
@given(st.integers(1, 60), st.floats(0.0, 30.0), st.floats(-2.0, 2.0), st.floats(-3.0, 3.0))
def test_a_straight_path_is_followed_exactly(num_frames, smoothing, speed, offset):
    qpos = np.zeros((num_frames, 30))
    qpos[:, 0] = offset + speed * np.arange(num_frames)
    path = follow_pelvis(qpos, smoothing)
    assert path.shape == (num_frames, 3)
    np.testing.assert_allclose(path, qpos[:, :3], atol=1e-9)


def test_smoothing_takes_out_what_shakes():
    qpos = np.zeros((200, 30))
    qpos[:, 1] = np.random.default_rng(0).standard_normal(200)
    path = follow_pelvis(qpos, 10.0)
    assert np.diff(path[:, 1]).std() < 0.05 * np.diff(qpos[:, 1]).std()


def test_the_camera_goes_along_but_not_up_with_a_jump(robot, short_clip):
    """A walk of 1 m/s is followed exactly, a hop of 0.2 m by less than 5 cm."""
    time = np.arange(101) / 50
    qpos = np.tile(short_clip.qpos[0], (101, 1))
    qpos[:, 0] = time
    qpos[40:61, 2] += 0.2 * np.sin(np.pi * np.arange(21) / 20)
    path = camera_path(recording_of_clip(clip_from_qpos(qpos, 50.0, robot), ""))
    np.testing.assert_allclose(path[:, 0], time, atol=1e-9)
    assert np.ptp(path[:, 2]) < 0.05


def test_all_of_the_robot_fits_into_its_pictures(robot, short_clip):
    """A hand 1.2 m above the middle needs (1.2 + 0.15) / tan(22.5 degrees) = 3.26 m."""
    away = np.abs(short_clip.body_pos_w[..., 2] - 0.3)
    high = np.tile([0.0, 0.0, 0.3], (41, 1))
    expected = (away.max() + 0.15) / np.tan(np.pi / 8)
    assert fitting_distance([short_clip.body_pos_w], high, 4 / 3) == pytest.approx(expected)
    middle = short_clip.qpos[:, :3]
    assert fitting_distance([short_clip.body_pos_w], middle, 4 / 3) == 2.5
    assert fitting_distance([short_clip.body_pos_w], middle, 0.3) > 3.0


def test_a_fall_does_not_draw_the_videos_camera_down(standing, falling):
    upright = camera_path(recording_of_trajectory(standing, ""))
    path = camera_path(recording_of_trajectory(falling, ""))
    np.testing.assert_allclose(path[:, 2], upright[:, 2])
    np.testing.assert_allclose(path[:, 2], 0.78)


def at(*points: tuple[float, float, float]) -> np.ndarray:
    """Bodies [1, bodies, 3] in one picture."""
    return np.array([points])


FACING_X = np.array([0.0, 0.0, 0.78, 1.0, *[0.0] * 26])
ORIGIN = np.zeros((1, 3))
# The usual camera looks along 150 degrees from the heading; this is to the right of its pictures.
RIGHT = np.array([0.5, np.sqrt(0.75), 0.0])
SLOPE = 0.41421  # tan(22.5 degrees); each body reaches 0.15 m around its origin


def test_camera_is_as_far_as_the_bodies_need():
    """From 1.3 m below to 1.3 m above: 1.45 m each way; the picture is centred."""
    camera, lookat = frame_robots([at((0, 0, 1.3), (0, 0, -1.3))], ORIGIN, FACING_X, 1.0)
    assert camera.distance_m == pytest.approx(1.45 / SLOPE, rel=1e-4)
    np.testing.assert_allclose(lookat, ORIGIN, atol=1e-12)
    camera, _ = frame_robots([at(0.85 * RIGHT, -0.85 * RIGHT)], ORIGIN, FACING_X, 0.75)
    assert camera.distance_m == pytest.approx(1.0 / 0.75 / SLOPE, rel=1e-4)
    behind = np.array([-RIGHT[1], RIGHT[0], 0.0])  # along the line of sight nothing is needed
    camera, _ = frame_robots([at(2 * behind, -2 * behind)], ORIGIN, FACING_X, 0.75)
    assert camera.distance_m == 2.5


def test_camera_turns_with_the_heading():
    turned = FACING_X.copy()
    turned[[3, 6]] = np.sqrt(0.5)  # facing y: what was to the right is now along the line of sight
    camera, _ = frame_robots([at(1.1 * RIGHT, -1.1 * RIGHT)], ORIGIN, turned, 1.0)
    assert camera.distance_m == 2.5


def test_a_robot_that_fell_aside_moves_the_middle():
    """The reference in the middle, the other 1.2 m to the right: 0.6 m is between the two."""
    camera, lookat = frame_robots([at((0, 0, 0)), at(1.2 * RIGHT)], ORIGIN, FACING_X, 1.0)
    np.testing.assert_allclose(lookat[0], 0.6 * RIGHT, atol=1e-12)
    assert camera.distance_m == 2.5


def test_a_robot_that_ran_away_does_not_take_the_camera_with_it():
    """At 4 m a picture reaches 4 * 0.41421 m, less 0.15 m: so far the reference may be off."""
    camera, lookat = frame_robots([at((0, 0, 0)), at(9.0 * RIGHT)], ORIGIN, FACING_X, 1.0)
    assert camera.distance_m == FARTHEST_M == 4.0
    np.testing.assert_allclose(lookat[0], (4 * SLOPE - 0.15) * RIGHT, rtol=1e-4)
