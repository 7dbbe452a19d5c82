"""Curves of a clip and of a policy: which joints and bodies there are, limits and marks."""

import imageio.v3 as iio
import numpy as np
import pytest

from tlr_exp.evaluation.result import evaluate_trajectory
from tlr_exp.motion.clip import clip_from_qpos
from tlr_exp.pictures.media import write_figure
from tlr_exp.pictures.plots import (
    body_error_figure,
    body_figure,
    joint_error_figure,
    joint_figure,
)
from tlr_exp.reward.split import RewardSplit
from tlr_exp.robot.g1 import G1

SPLIT = RewardSplit({"body_pos": 1.0}, {}, 0.02, ["body_pos"])
LIMITS = {"max_tilt": 0.8, "max_distance_m": 0.3}


def test_every_joint_is_drawn_with_its_limits(robot, short_clip):
    figure = joint_figure(short_clip, robot, "short")
    panels = {axis.get_title(): axis for axis in figure.axes if axis.get_title()}
    assert len(panels) == 13  # 23 joints, left and right in one panel, three of the waist
    assert sum(len(axis.get_lines()) for axis in panels.values()) == 23
    elbow = [line.get_ydata() for line in panels["elbow"].get_lines()]
    joint = G1.joint_names.index("right_elbow_joint")
    np.testing.assert_array_equal(elbow[1], short_clip.qpos[:, 7 + joint])
    roll = [line.get_ydata() for line in panels["shoulder roll"].get_lines()]
    joint = G1.joint_names.index("right_shoulder_roll_joint")
    np.testing.assert_array_equal(roll[1], -short_clip.qpos[:, 7 + joint])
    assert [text.get_text() for text in panels["knee"].texts] == ["-0.09 to 2.88"]
    velocities = [axis for axis in figure.axes if not axis.get_title()]
    assert "±20" in [text.get_text() for axis in velocities for text in axis.texts]


def test_a_joint_beyond_its_limit_is_in_the_shade(robot, short_clip):
    """The shade begins at the limit, and the view reaches as far as the curve."""
    qpos = short_clip.qpos.copy()
    qpos[20, 7 + 3] = 2.8798 + 0.04
    clip = clip_from_qpos(qpos, 50.0, robot)
    (knee,) = (a for a in joint_figure(clip, robot, "").axes if a.get_title() == "knee")
    shade = [patch.get_extents() for patch in knee.patches]
    limit = knee.transData.transform([0.0, 2.8798])[1]
    assert any(box.y0 == pytest.approx(limit) and box.height > 0 for box in shade)
    assert knee.get_ylim()[1] > 2.92


def test_bodies_are_drawn(robot, short_clip, tmp_path):
    figure = body_figure(short_clip, robot, "short")
    height, speed, _, image, _ = figure.axes
    lines = {line.get_label(): line.get_ydata() for line in height.get_lines()}
    hand = G1.tracked_bodies.index("left_hand")
    np.testing.assert_array_equal(lines["left hand"], short_clip.body_pos_w[:, hand, 2])
    speeds = {line.get_label(): line.get_ydata() for line in speed.get_lines()}
    expected = np.linalg.norm(short_clip.body_lin_vel_w[:, hand], axis=1)
    np.testing.assert_array_equal(speeds["left hand"], expected)
    assert image.get_images()[0].get_array().shape == (27, 41)
    assert iio.imread(write_figure(tmp_path / "a.png", figure)).shape[:2] == (1210, 1320)


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
