"""The clip of an exported policy: fewer bytes, the same reference."""

import dataclasses

import numpy as np

from tlr_exp.export.small_clip import same_reference, small_clip
from tlr_exp.motion.clip import MotionClip
from tlr_exp.robot.g1 import G1


def test_it_is_smaller_and_every_bit_of_the_reference_stays(short_clip, tmp_path):
    for name, clip in (("whole", short_clip), ("small", small_clip(short_clip))):
        clip.save(tmp_path / name)
    assert (tmp_path / "small").stat().st_size < 0.8 * (tmp_path / "whole").stat().st_size
    assert same_reference(MotionClip.load(tmp_path / "small", G1), short_clip)


def test_a_clip_that_is_small_already_is_left_as_it_is(short_clip):
    once = small_clip(short_clip)
    again = small_clip(once)
    assert np.array_equal(once.qpos, again.qpos)
    assert np.array_equal(once.body_ang_vel_w, again.body_ang_vel_w)


def test_a_reference_differs_from_the_last_digit_of_float32_on(short_clip):
    for factor, same in ((1 + 1e-12, True), (1 + 1e-6, False)):
        other = dataclasses.replace(short_clip, body_pos_w=short_clip.body_pos_w * factor)
        assert same_reference(short_clip, other) is same
