"""Strips of policies: which moments, where the camera is, who has fallen; and the error curves."""

import dataclasses

import numpy as np
import pytest
from trajectories import trajectory_of

from tlr_exp.evaluation.result import evaluate_trajectory
from tlr_exp.evaluation.trajectory import Trajectory
from tlr_exp.pictures.error_plots import body_error_figure, joint_error_figure
from tlr_exp.pictures.film import camera_path
from tlr_exp.pictures.framing import FARTHEST_M, frame_robots
from tlr_exp.pictures.graphics import GraphicsUnavailable, graphics_backend
from tlr_exp.pictures.policy_strips import StripRow, moments, policy_strip, strip_lookat
from tlr_exp.reward.split import RewardSplit
from tlr_exp.robot.g1 import G1

STEPS = 30
FALL = 12  # the first step of the falling robot that counts as fallen
LYING = (np.cos(np.pi / 4), 0.0, np.sin(np.pi / 4), 0.0)  # a quarter turn about y: on its face
SPLIT = RewardSplit({"body_pos": 1.0}, {}, 0.02, ["body_pos"])
LIMITS = {"max_tilt": 0.8, "max_distance_m": 0.3}


@pytest.fixture(scope="module")
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


def row(trajectory: Trajectory, label: str = "static") -> StripRow:
    result = evaluate_trajectory(trajectory, **LIMITS, split=SPLIT)
    return StripRow(label, trajectory, result, LIMITS["max_tilt"])


def test_columns_are_even_and_hold_both_ends():
    assert moments(30, 4).tolist() == [0, 10, 19, 29]  # 9.67 and 19.33 rounded
    assert moments(30, 1).tolist() == [0]
    assert moments(5, 5).tolist() == [0, 1, 2, 3, 4]


def test_who_fell_and_when(standing, falling):
    assert row(standing).first_fall is None
    assert row(falling).first_fall == FALL
    unstable = standing.unstable.copy()
    unstable[20:] = True
    assert row(dataclasses.replace(standing, unstable=unstable)).first_fall == 20


def test_camera_looks_at_one_height(standing):
    hopping = standing.reference_qpos.copy()
    hopping[::2, 2] += 0.4
    lookat = strip_lookat(hopping)
    np.testing.assert_allclose(lookat[:, 2], standing.reference_qpos[:, 2] + 0.2)
    np.testing.assert_array_equal(lookat[:, :2], hopping[:, :2])


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


def test_a_fall_does_not_draw_the_videos_camera_down(standing, falling):
    upright = camera_path(standing)
    path = camera_path(falling)
    np.testing.assert_allclose(path[:, 2], upright[:, 2])
    np.testing.assert_allclose(path[:, 2], 0.78)


@pytest.mark.usefixtures("can_draw")
def test_a_strip_has_a_row_for_the_reference_and_for_each_policy(robot, standing, falling):
    rows = [row(standing), row(falling, "two-layered (GWO)\nseed 1")]
    size = {"width": 60, "height": 80, "quality": "fast"}
    strip = policy_strip(robot, rows, title="gym", columns=3, **size)
    height, width = strip.shape[:2]
    left, top = width - 3 * 62, height - 3 * 82  # pictures stand 2 pixels apart

    def picture(i: int, j: int) -> np.ndarray:
        y, x = top + 82 * i, left + 62 * j
        return strip[y : y + 80, x : x + 60].astype(int)

    red = [[_share_red(picture(i, j)) > 0.05 for j in range(3)] for i in range(3)]
    # The columns are steps 0, 14 and 29; the fall is at step 12, of the second policy.
    assert red == [[False] * 3, [False] * 3, [False, True, True]]
    # Same camera, same state: the reference and the policy that tracks it are drawn alike.
    assert np.abs(picture(0, 0) - picture(1, 0))[:55].mean() < 6
    assert np.abs(picture(0, 1) - picture(2, 1))[:55].mean() > 6
    assert all(picture(i, j).std() > 5 for i in range(3) for j in range(3))


def _share_red(picture: np.ndarray) -> float:
    r, g, b = np.moveaxis(picture, -1, 0)
    return float(((r > 150) & (g < 80) & (b < 80)).mean())


def test_what_is_no_strip_is_refused(robot, standing):
    with pytest.raises(ValueError, match="at least one policy"):
        policy_strip(robot, [])
    with pytest.raises(ValueError, match="columns is 31; the motion has 1 to 30 moments"):
        policy_strip(robot, [row(standing)], columns=31)
    other = dataclasses.replace(standing, reference_qpos=standing.reference_qpos + 0.01)
    with pytest.raises(ValueError, match="'b' and 'a' have different references"):
        policy_strip(robot, [row(standing, "a"), row(other, "b")])


def test_every_joint_is_drawn_beside_its_reference(standing):
    figure = joint_error_figure(standing, "a run")
    panels = {axis.get_title(): axis for axis in figure.axes if axis.get_title()}
    assert len(panels) == 23
    assert "left elbow: 0.100 rad" in panels
    assert "right elbow: 0.000 rad" in panels
    reference, robot = panels["left elbow: 0.100 rad"].get_lines()
    np.testing.assert_allclose(robot.get_ydata() - reference.get_ydata(), 0.1)
    np.testing.assert_allclose(robot.get_xdata()[[0, -1]], [0.02, 0.6])


def test_every_body_is_drawn_with_its_distance(falling):
    """0 m before the fall, 0.6 m after it: 18 of 30 steps, 0.36 m on average."""
    figure = body_error_figure(
        falling, evaluate_trajectory(falling, **LIMITS, split=SPLIT), "a run"
    )
    mean, _, image, bars = figure.axes[:4]
    lines = {line.get_label(): line for line in mean.get_lines()}
    np.testing.assert_allclose(lines["upper body"].get_ydata(), [0.0] * 12 + [0.6] * 18)
    assert lines["fell (0.26 s)"].get_xdata()[0] == pytest.approx(0.26)  # the 13th step's end
    assert "training would have stopped (0.26 s)" in lines
    np.testing.assert_allclose([bar.get_width() for bar in bars.patches], 0.36)
    assert image.get_images()[0].get_array().shape == (27, 30)
    assert len({label.get_text() for label in image.get_yticklabels()}) == 27


def test_what_did_not_happen_is_not_marked(standing):
    figure = body_error_figure(
        standing, evaluate_trajectory(standing, **LIMITS, split=SPLIT), "a run"
    )
    labels = [line.get_label() for line in figure.axes[0].get_lines()]
    assert labels == ["upper body", "lower body"]
