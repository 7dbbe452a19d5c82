"""Strips: which moments, who has fallen, what stands above and beside the pictures."""

import dataclasses

import numpy as np
import pytest

from tlr_exp.evaluation.result import evaluate_trajectory
from tlr_exp.evaluation.trajectory import Trajectory
from tlr_exp.pictures.recording import Recording, recording_of_clip
from tlr_exp.pictures.render import render_frames
from tlr_exp.pictures.strips import (
    StripRow,
    keyframe_strip,
    moments,
    policy_strip,
    strip_lookat,
)
from tlr_exp.reward.split import RewardSplit

FALL = 12  # the first step of the falling robot that counts as fallen
SPLIT = RewardSplit({"body_pos": 1.0}, {}, 0.02, ["body_pos"])
LIMITS = {"max_tilt": 0.8, "max_distance_m": 0.3}


def row(trajectory: Trajectory, label: str = "static") -> StripRow:
    result = evaluate_trajectory(trajectory, **LIMITS, split=SPLIT)
    return StripRow(label, trajectory, result, LIMITS["max_tilt"])


def test_columns_are_even_and_hold_both_ends():
    assert moments(30, 4).tolist() == [0, 10, 19, 29]  # 9.67 and 19.33 rounded
    assert moments(30, 1).tolist() == [0]
    assert moments(5, 5).tolist() == [0, 1, 2, 3, 4]


def test_who_fell_and_when(standing, falling):
    assert row(standing).first_fall is None
    assert row(falling).first_fall == FALL
    unstable = standing.unstable.copy()
    unstable[20:] = True
    assert row(dataclasses.replace(standing, unstable=unstable)).first_fall == 20


def test_camera_looks_at_one_height(standing):
    hopping = standing.reference_qpos.copy()
    hopping[::2, 2] += 0.4
    lookat = strip_lookat(hopping)
    np.testing.assert_allclose(lookat[:, 2], standing.reference_qpos[:, 2] + 0.2)
    np.testing.assert_array_equal(lookat[:, :2], hopping[:, :2])


@pytest.mark.usefixtures("can_draw")
def test_a_strip_of_keyframes_is_the_frames_side_by_side_below_their_times(robot, short_clip):
    states = np.tile(short_clip.qpos[0], (3, 1))
    states[:, 7 + 15] = [-2.0, 0.0, 1.0]
    recording = Recording("three", 0.5, states, None, ("",) * 3)
    size = {"width": 64, "height": 48, "quality": "fast"}
    strip = keyframe_strip(robot, recording, np.array([2, 0]), **size)
    assert strip.shape == (20 + 48, 2 * 64, 3)
    frames = list(render_frames(robot, states[[2, 0]], **size))
    np.testing.assert_array_equal(strip[20:], np.concatenate(frames, axis=1))
    assert all((strip[:20, i * 64 : (i + 1) * 64] != 255).any() for i in range(2))


@pytest.mark.usefixtures("can_draw")
def test_a_strip_of_a_clip_has_a_column_for_each_time(robot, short_clip):
    recording = recording_of_clip(short_clip, "short")
    frames = recording.frames_at(np.array([0.0, 0.4, 0.8]))
    strip = keyframe_strip(robot, recording, frames, width=48, height=60, quality="fast")
    columns = [strip[-60:, 48 * i : 48 * (i + 1)].astype(int) for i in range(3)]
    assert all(column.std() > 5 for column in columns)
    assert (columns[0] != columns[1]).any()


@pytest.mark.usefixtures("can_draw")
def test_a_strip_has_a_row_for_the_reference_and_for_each_policy(robot, standing, falling):
    rows = [row(standing), row(falling, "two-layered (GWO)\nseed 1")]
    size = {"width": 60, "height": 80, "quality": "fast"}
    strip = policy_strip(robot, rows, title="gym", columns=3, **size)
    height, width = strip.shape[:2]
    left, top = width - 3 * 62, height - 3 * 82  # pictures stand 2 pixels apart

    def picture(i: int, j: int) -> np.ndarray:
        y, x = top + 82 * i, left + 62 * j
        return strip[y : y + 80, x : x + 60].astype(int)

    red = [[_share_red(picture(i, j)) > 0.05 for j in range(3)] for i in range(3)]
    # The columns are steps 0, 14 and 29; the fall is at step 12, of the second policy.
    assert red == [[False] * 3, [False] * 3, [False, True, True]]
    # Same camera, same state: the reference and the policy that tracks it are drawn alike.
    assert np.abs(picture(0, 0) - picture(1, 0))[:55].mean() < 6
    assert np.abs(picture(0, 1) - picture(2, 1))[:55].mean() > 6
    assert all(picture(i, j).std() > 5 for i in range(3) for j in range(3))


def _share_red(picture: np.ndarray) -> float:
    r, g, b = np.moveaxis(picture, -1, 0)
    return float(((r > 150) & (g < 80) & (b < 80)).mean())


def test_what_is_no_strip_is_refused(robot, standing):
    with pytest.raises(ValueError, match="at least one policy"):
        policy_strip(robot, [])
    with pytest.raises(ValueError, match="columns is 31; the motion has 1 to 30 moments"):
        policy_strip(robot, [row(standing)], columns=31)
    other = dataclasses.replace(standing, reference_qpos=standing.reference_qpos + 0.01)
    with pytest.raises(ValueError, match="'b' and 'a' have different references"):
        policy_strip(robot, [row(standing, "a"), row(other, "b")])
