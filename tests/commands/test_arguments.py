"""Arguments that commands share: sizes of pictures."""

import argparse

import pytest

from tlr_exp.commands.arguments import size_argument


def test_width_comes_first():
    assert size_argument("640x480") == (640, 480)


@pytest.mark.parametrize("text", ["640", "640x", "x480", "-640x480", "640 x 480", "a x b", ""])
def test_what_is_no_size_is_answered_by_an_example(text):
    with pytest.raises(argparse.ArgumentTypeError, match="expected one like 640x480"):
        size_argument(text)


@pytest.mark.parametrize("text", ["641x480", "640x481", "14x480", "640x4098"])
def test_sides_that_no_video_can_have(text):
    with pytest.raises(argparse.ArgumentTypeError, match="even, from 16 to 4096"):
        size_argument(text)
