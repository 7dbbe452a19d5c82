"""Clips one after the other: halves give the whole, and nothing jumps at a seam."""

import numpy as np
import pytest

from tlr_exp.motion.clip import clip_from_qpos, resample
from tlr_exp.motion.quality.joining import join_clips
from tlr_exp.motion.quality.jumps import accelerations
from tlr_exp.motion.quaternions import angle_between, from_euler, heading, rotate
from tlr_exp.robot.g1 import G1


def moved(qpos: np.ndarray, yaw: float, x: float, y: float, z: float = 0.0) -> np.ndarray:
    """[T, 30] turned about the vertical through the origin, then moved."""
    turn = from_euler(np.array(yaw), np.array(0.0), np.array(0.0))
    qpos = qpos.copy()
    qpos[:, :3] = rotate(turn[None], qpos[:, :3]) + np.array([x, y, z])
    w, axis = qpos[:, 3:4].copy(), qpos[:, 4:7].copy()
    qpos[:, 4:7] = turn[0] * axis + w * turn[1:] + np.cross(turn[1:], axis)
    qpos[:, 3:4] = turn[0] * w - axis @ turn[1:, None]
    return qpos


@pytest.mark.parametrize("blend_s", [0.0, 0.5])
def test_two_halves_give_the_clip_back(swaying_clip, robot, blend_s):
    """Every joint moves and the pelvis turns at the seam; the halves share a frame."""
    first = clip_from_qpos(swaying_clip.qpos[:51], 50.0, robot)
    second = clip_from_qpos(moved(swaying_clip.qpos[50:], 1.0, 5.0, -3.0), 50.0, robot)
    joined, (seam,) = join_clips([first, second], robot, blend_s)
    assert joined.num_frames == swaying_clip.num_frames
    np.testing.assert_allclose(joined.qpos, swaying_clip.qpos, atol=2e-4)
    np.testing.assert_allclose(joined.qvel, swaying_clip.qvel, atol=1e-2)
    assert seam.time_s == pytest.approx(1.0)
    assert seam.turned_rad == pytest.approx(-1.0)
    assert seam.joint_gap_rad == pytest.approx(0.0, abs=1e-9)


def test_the_next_clip_goes_on_where_the_last_ends(swaying_clip, standing, make_clip, robot):
    """After the blend the second clip is as it was, but for its place and heading."""
    still = make_clip(standing)
    joined, (seam,) = join_clips([swaying_clip, still], robot, 0.4)
    assert joined.num_frames == 101 + 61 - 1
    end = swaying_clip.qpos[-1]
    after = joined.qpos[101 + 20 :]
    np.testing.assert_allclose(after[:, :2], np.tile(end[:2], (len(after), 1)), atol=1e-9)
    np.testing.assert_allclose(after[:, 2], standing[0, 2], atol=1e-9)
    np.testing.assert_allclose(after[:, 7:], standing[: len(after), 7:], atol=1e-12)
    turn = from_euler(np.array(heading(end[3:7])), np.array(0.0), np.array(0.0))
    assert angle_between(after[:, 3:7], turn[None]).max() < 1e-9
    np.testing.assert_array_equal(joined.qpos[:100], swaying_clip.qpos[:100])
    assert seam.height_gap_m == pytest.approx(end[2] - standing[0, 2])
    gap = np.abs(end[7:] - standing[0, 7:])
    assert (seam.joint_gap_rad, seam.joint) == (gap.max(), G1.joint_names[gap.argmax()])


def test_nothing_jumps_at_a_seam(swaying_clip, gym_clip, robot):
    joined, _ = join_clips([swaying_clip, gym_clip, swaying_clip], robot, 0.5)
    for values, limit in zip(accelerations(joined.qpos, 50.0), (20.0, 60.0, 60.0), strict=True):
        assert values.max() < limit
    abrupt, _ = join_clips([swaying_clip, gym_clip], robot, 0.0)
    assert accelerations(abrupt.qpos, 50.0)[2].max() > 500


def test_other_rates_are_resampled(swaying_clip, robot):
    slow = resample(swaying_clip, 30.0, robot)
    joined, _ = join_clips([swaying_clip, slow], robot)
    assert joined.fps == 50.0
    assert joined.duration_s == pytest.approx(4.0)


def test_joints_stay_within_their_limits(standing, make_clip, robot):
    """A knee near its limit that is still moving towards it is stopped at it, and that is said."""
    knee = 7 + G1.joint_names.index("left_knee_joint")
    limit = robot.joint_range_rad[knee - 7, 1]
    first, second = standing.copy(), standing.copy()
    first[:, knee] = np.linspace(limit - 2.0, limit - 0.005, 61)
    second[:, knee] = limit - 0.01
    joined, (seam,) = join_clips([make_clip(first), make_clip(second)], robot, 0.5)
    assert seam.clamped_rad > 0.01
    assert joined.qpos[:, knee].max() == limit


def test_what_cannot_be_joined(standing, make_clip, robot):
    clip, short = make_clip(standing), make_clip(standing[:10])
    with pytest.raises(ValueError, match="at least two clips"):
        join_clips([clip], robot)
    with pytest.raises(ValueError, match=r"clip 2 lasts 0\.18 s, which is shorter than the blend"):
        join_clips([clip, short], robot)
    with pytest.raises(ValueError, match="must not be negative"):
        join_clips([clip, clip], robot, -0.1)
