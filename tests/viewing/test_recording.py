"""What viewers play, and the clock that plays it."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from trajectories import trajectory_of

from tlr_exp.viewing.recording import (
    Player,
    Recording,
    recording_of_clip,
    recording_of_trajectory,
)


def recording(num_frames: int = 5, dt_s: float = 0.1) -> Recording:
    return Recording("five", dt_s, np.zeros((num_frames, 30)), None, ("",) * num_frames)


def test_playing_goes_from_state_to_state():
    player = Player(recording())
    frames = []
    for _ in range(7):
        frames.append(player.frame)
        player.advance(0.1)
    assert frames == [0, 1, 2, 3, 4, 0, 1]  # the last state lasts as long as the others


def test_speed_and_pause():
    player = Player(recording(), speed=0.5)
    player.advance(0.4)
    assert player.frame == 2
    player.toggle()
    player.advance(9.0)
    assert player.frame == 2


def test_without_a_loop_it_stops_at_the_end_and_begins_again_when_asked():
    player = Player(recording(), loop=False)
    player.advance(3.0)
    assert (player.frame, player.playing) == (4, False)
    player.toggle()
    assert (player.frame, player.playing) == (0, True)


def test_seek_stays_within_the_recording():
    player = Player(recording())
    for time_s, frame in ((0.26, 3), (-1.0, 0), (9.0, 4)):
        player.seek(time_s)
        assert player.frame == frame


@given(
    num_frames=st.integers(1, 50),
    dt_s=st.sampled_from([0.02, 1 / 30, 0.1]),
    steps=st.lists(st.floats(0.0, 5.0), max_size=20),
    loop=st.booleans(),
)
def test_there_is_always_a_state_to_show(num_frames, dt_s, steps, loop):
    player = Player(recording(num_frames, dt_s), loop=loop)
    for elapsed_s in steps:
        player.advance(elapsed_s)
        assert 0 <= player.frame < num_frames


def test_every_state_of_a_recording_can_be_sought():
    player = Player(recording(400, 0.02))
    for frame in range(400):
        player.seek(round(frame * 0.02, 6))
        assert player.frame == frame


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
