"""Films: how many frames, how fast, what is told meanwhile."""

import imageio_ffmpeg
import numpy as np
import pytest
from trajectories import trajectory_of

from tlr_exp.pictures.film import film
from tlr_exp.pictures.recording import recording_of_clip, recording_of_trajectory

pytestmark = pytest.mark.usefixtures("can_draw")


def test_film_of_a_clip_runs_in_real_time(robot, short_clip, tmp_path):
    told = []
    path = film(
        *(tmp_path / "clip.mp4", robot, recording_of_clip(short_clip, "short")),
        heading="short",
        width=64,
        height=48,
        frame_rate_hz=10.0,
        drawn=told.append,
    )
    count, duration_s = imageio_ffmpeg.count_frames_and_secs(str(path))
    assert told == list(range(1, 10))
    assert count == 9  # every fifth of 41 frames
    assert duration_s == pytest.approx(0.9, abs=0.01)


def test_film_of_an_evaluation_runs_in_real_time(robot, short_clip, tmp_path):
    qpos, bodies = np.tile(short_clip.qpos[0], (20, 1)), np.zeros((20, 27, 3))
    recording = recording_of_trajectory(trajectory_of(qpos, qpos, bodies, bodies), "a run")
    path = film(tmp_path / "film.mp4", robot, recording, width=64, height=48)
    count, duration_s = imageio_ffmpeg.count_frames_and_secs(str(path))
    assert count == 10
    assert duration_s == pytest.approx(20 * 0.02, abs=0.01)
