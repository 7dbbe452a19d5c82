"""Pictures of a clip: which frames, where the camera is, what the curves show."""

import imageio.v3 as iio
import imageio_ffmpeg
import numpy as np
import pytest

from tlr_exp.motion.clip import clip_from_qpos
from tlr_exp.pictures.clip_pictures import (
    camera_path,
    film_clip,
    fitting_distance,
    moment,
    shown_frames,
    strip_of_clip,
)
from tlr_exp.pictures.clip_plots import body_figure, joint_figure, write_figure
from tlr_exp.pictures.graphics import GraphicsUnavailable, graphics_backend
from tlr_exp.robot.g1 import G1


@pytest.fixture(scope="module")
def can_draw() -> None:
    try:
        graphics_backend()
    except GraphicsUnavailable as error:
        pytest.skip(str(error))


def test_a_video_shows_every_second_frame_of_50(short_clip):
    assert shown_frames(short_clip, 25.0).tolist() == list(range(0, 41, 2))
    assert shown_frames(short_clip, 1000.0).tolist() == list(range(41))
    assert len(shown_frames(short_clip, 0.01)) == 2
    for rate in (0.0, -5.0, float("nan")):
        with pytest.raises(ValueError, match="must be positive"):
            shown_frames(short_clip, rate)


def test_time_and_phase(short_clip):
    assert moment(short_clip, 10) == "0.20 s of 0.80 s   phase 0.25"


def test_the_camera_goes_along_but_not_up_with_a_jump(robot, short_clip):
    """A walk of 1 m/s is followed exactly, a hop of 0.2 m by less than 5 cm."""
    time = np.arange(101) / 50
    qpos = np.tile(short_clip.qpos[0], (101, 1))
    qpos[:, 0] = time
    qpos[40:61, 2] += 0.2 * np.sin(np.pi * np.arange(21) / 20)
    path = camera_path(clip_from_qpos(qpos, 50.0, robot))
    np.testing.assert_allclose(path[:, 0], time, atol=1e-9)
    assert np.ptp(path[:, 2]) < 0.05


def test_all_of_the_robot_fits_into_its_pictures(robot, short_clip):
    """A hand 1.2 m above the middle needs (1.2 + 0.15) / tan(22.5 degrees) = 3.26 m."""
    away = np.abs(short_clip.body_pos_w[..., 2] - 0.3)
    high = np.tile([0.0, 0.0, 0.3], (41, 1))
    expected = (away.max() + 0.15) / np.tan(np.pi / 8)
    assert fitting_distance(short_clip, high, 4 / 3) == pytest.approx(expected)
    middle = short_clip.qpos[:, :3]
    assert fitting_distance(short_clip, middle, 4 / 3) == 2.5
    assert fitting_distance(short_clip, middle, 0.3) > 3.0


@pytest.mark.usefixtures("can_draw")
def test_film_of_a_clip_runs_in_real_time(robot, short_clip, tmp_path):
    told = []
    path = film_clip(
        *(tmp_path / "clip.mp4", robot, short_clip, "short"),
        width=64,
        height=48,
        frame_rate_hz=10.0,
        drawn=lambda done, of: told.append((done, of)),
    )
    count, duration_s = imageio_ffmpeg.count_frames_and_secs(str(path))
    assert told == [(k, 9) for k in range(1, 10)]
    assert count == 9  # every fifth of 41 frames
    assert duration_s == pytest.approx(0.9, abs=0.01)


@pytest.mark.usefixtures("can_draw")
def test_strip_has_a_column_for_each_time(robot, short_clip, tmp_path):
    times = np.array([0.0, 0.4, 0.8])
    size = {"width": 48, "height": 60, "quality": "fast"}
    strip = iio.imread(strip_of_clip(tmp_path / "a.png", robot, short_clip, times, **size))
    assert strip.shape[1] == 3 * 48
    columns = [strip[-60:, 48 * i : 48 * (i + 1)].astype(int) for i in range(3)]
    assert all(column.std() > 5 for column in columns)
    assert (columns[0] != columns[1]).any()
    with pytest.raises(ValueError, match=r"0\.9 s is not within the clip of 0\.80 s"):
        strip_of_clip(tmp_path / "b.png", robot, short_clip, np.array([0.9]), **size)
    assert [path.name for path in tmp_path.iterdir()] == ["a.png"]


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
