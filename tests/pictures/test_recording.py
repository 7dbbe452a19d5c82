"""Recordings: what they are made of, and which of their states a time or a rate means."""

import numpy as np
import pytest
from trajectories import trajectory_of

from tlr_exp.pictures.recording import Recording, recording_of_clip, recording_of_trajectory


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"dt_s": 0.0}, "dt_s is 0.0"),
        ({"qpos": np.zeros((0, 30)), "captions": ()}, "qpos has the shape"),
        ({"qpos": np.full((5, 30), np.nan)}, "not finite"),
        ({"reference_qpos": np.zeros((4, 30))}, "reference_qpos is"),
        ({"captions": ("a",)}, "1 captions for 5 states"),
    ],
)
def test_what_cannot_be_played_is_refused(changes, message):
    fields = {"title": "", "dt_s": 0.1, "qpos": np.zeros((5, 30)), "reference_qpos": None}
    with pytest.raises(ValueError, match=message):
        Recording(**{**fields, "captions": ("",) * 5, **changes})


def test_a_clip_becomes_a_recording(short_clip):
    made = recording_of_clip(short_clip, "short")
    assert made.dt_s == 0.02
    assert made.duration_s == pytest.approx(0.8)
    assert made.reference_qpos is None
    assert made.captions[10] == "0.20 s of 0.80 s   phase 0.25"


def test_a_roll_out_becomes_a_recording_with_its_reference(short_clip):
    qpos = short_clip.qpos[:10] + 0.0
    bodies = short_clip.body_pos_w[:10]
    above = bodies + np.array([0.0, 0.0, 0.1])
    trajectory = trajectory_of(qpos, short_clip.qpos[:10], above, bodies)
    made = recording_of_trajectory(trajectory, "a run")
    assert made.reference_qpos is not None
    np.testing.assert_array_equal(made.reference_qpos, short_clip.qpos[:10])
    assert made.start_s == 0.02  # the first state is the end of the first step
    assert made.captions[4] == "0.10 s   phase 0.50\nupper body 0.100 m   lower body 0.100 m"


def test_a_video_shows_every_second_frame_of_50(short_clip):
    recording = recording_of_clip(short_clip, "short")
    every_second = recording.frames_at_rate(25.0)
    assert every_second.tolist() == list(range(0, 41, 2))
    assert recording.rate_of(every_second) == pytest.approx(25.0)
    assert recording.frames_at_rate(1000.0).tolist() == list(range(41))
    assert len(recording.frames_at_rate(0.01)) == 2
    for rate in (0.0, -5.0, float("nan")):
        with pytest.raises(ValueError, match="must be positive"):
            recording.frames_at_rate(rate)


def test_times_mean_the_nearest_states(short_clip):
    recording = recording_of_clip(short_clip, "short")
    assert recording.frames_at(np.array([0.0, 0.409, 0.8])).tolist() == [0, 20, 40]
    with pytest.raises(ValueError, match=r"0\.9 s is not within the clip of 0\.80 s"):
        recording.frames_at(np.array([0.9]))
