"""The clock that plays a recording."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from tlr_exp.pictures.recording import Recording
from tlr_exp.viewing.player import Player


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
