"""The same motion at another rate."""

import numpy as np
import pytest
from scipy.interpolate import interp1d

from tlr_exp.motion.clip import (
    clip_from_qpos,
    resample,
)
from tlr_exp.motion.quality.jumps import accelerations


def test_resample_30_to_50_hz_keeps_the_motion(robot, swaying_clip):
    coarse = resample(swaying_clip, 30.0, robot)
    assert coarse.num_frames == 61
    fine = resample(coarse, 50.0, robot)
    assert (fine.num_frames, fine.fps) == (101, 50.0)
    np.testing.assert_allclose(fine.qpos, swaying_clip.qpos, atol=1e-5)
    # Frames that fall together are the same: 3/30 s = 5/50 s.
    np.testing.assert_allclose(fine.qpos[::5], coarse.qpos[::3], atol=1e-12)


def sine_motion(fps: float) -> np.ndarray:
    """Two seconds: the pelvis, its roll and a knee swing as 2 Hz sines."""
    time = np.arange(round(2 * fps) + 1) / fps
    swing = np.sin(4 * np.pi * time + 0.3)
    qpos = np.zeros((len(time), 30))
    qpos[:, 2], qpos[:, 10] = 0.8 + 0.1 * swing, 1.0 + 0.5 * swing
    qpos[:, 3], qpos[:, 4] = np.cos(0.15 * swing), np.sin(0.15 * swing)
    return qpos


def test_resampling_invents_no_acceleration(robot):
    expected = sine_motion(50)
    found = resample(clip_from_qpos(sine_motion(30), 30.0, robot), 50.0, robot).qpos
    frame = np.arange(101) * 0.6
    linear = interp1d(np.arange(61), sine_motion(30), axis=0)(frame)
    for column in (2, 3, 4, 10):
        size = np.ptp(expected[:, column])
        error, of_lines = (np.abs(q - expected)[:, column].max() for q in (found, linear))
        assert error < 0.001 * size
        assert error < 0.1 * of_lines
    for expected_rate, rate, of_lines in zip(
        *(accelerations(qpos, 50) for qpos in (expected, found, linear)), strict=True
    ):
        assert rate.max() < 1.01 * expected_rate.max()
        assert np.abs(rate - expected_rate).max() < 0.05 * expected_rate.max()
        assert of_lines.max() > 1.5 * expected_rate.max()  # 5/3 where a frame is at its turn


def test_resampling_keeps_joints_within_their_limits(robot):
    qpos = np.zeros((40, 30))
    qpos[:, 2], qpos[:, 3] = 0.8, 1.0
    low, high = robot.joint_range_rad[3]
    # A knee that is driven hard against both stops, and a little beyond one of them.
    qpos[:, 10] = np.where(np.arange(40) % 8 < 4, high, low - 0.01)
    knee = resample(clip_from_qpos(qpos, 30.0, robot), 50.0, robot).qpos[:, 10]
    assert (knee.min(), knee.max()) == (low - 0.01, high)


@pytest.mark.parametrize("frames", [2, 3, 4])
def test_the_shortest_clips_are_resampled(robot, swaying_qpos, frames):
    short = resample(clip_from_qpos(swaying_qpos[:frames], 50.0, robot), 150.0, robot)
    assert short.num_frames == 3 * (frames - 1) + 1
    np.testing.assert_allclose(short.qpos[::3], swaying_qpos[:frames], atol=1e-12)


def test_resample_to_the_same_rate_is_the_clip_itself(robot, swaying_clip):
    assert resample(swaying_clip, 50.0, robot) is swaying_clip


def test_resample_refuses_a_rate_that_leaves_no_motion(robot, swaying_clip):
    with pytest.raises(ValueError, match=">= 2"):
        resample(swaying_clip, 0.1, robot)
    with pytest.raises(ValueError, match="positive"):
        resample(swaying_clip, 0.0, robot)
