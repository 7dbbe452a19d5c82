"""Reference: frames are the clip's, times between them are interpolated."""

import numpy as np
import pytest
import torch

from tlr_exp.motion.clip import resample
from tlr_exp.motion.quaternions import angle_between
from tlr_exp.motion.reference import Reference, ReferenceFrame


@pytest.fixture(scope="module")
def reference(swaying_clip) -> Reference:
    return Reference(swaying_clip)


def test_frame_returns_the_rows_of_the_clip(reference, swaying_clip):
    index = torch.tensor([0, 63, 100, 63])
    frame = reference.frame(index)
    for key in ReferenceFrame._fields:
        expected = getattr(swaying_clip, key)[index.numpy()].astype(np.float32)
        value = getattr(frame, key)
        assert value.dtype == torch.float32
        np.testing.assert_array_equal(value.numpy(), expected)


def test_frames_outside_take_the_first_or_last(reference):
    frame = reference.frame(torch.tensor([-3, 0, 100, 101]))
    assert torch.equal(frame.qpos[0], frame.qpos[1])
    assert torch.equal(frame.qpos[2], frame.qpos[3])


def test_whole_frames_by_time_are_those_by_number(reference):
    index = torch.arange(101)
    by_time, by_number = reference.at(index / 50), reference.frame(index)
    for first, second in zip(by_time, by_number, strict=True):
        torch.testing.assert_close(first, second, atol=1e-4, rtol=0)


def test_times_outside_are_clamped(reference):
    early, late = reference.at(torch.tensor([-1.0, 99.0])), reference.frame(torch.tensor([0, 100]))
    for first, second in zip(early, late, strict=True):
        torch.testing.assert_close(first, second, atol=1e-6, rtol=0)


def test_positions_and_velocities_between_frames_are_linear(reference, swaying_clip):
    frame = reference.at(torch.tensor([(40 + 0.25) / 50]))
    for key in ("qvel", "body_pos_w", "body_lin_vel_w", "body_ang_vel_w"):
        clip = getattr(swaying_clip, key)
        expected = 0.75 * clip[40] + 0.25 * clip[41]
        np.testing.assert_allclose(getattr(frame, key)[0].numpy(), expected, atol=1e-4)


def test_rotations_between_frames_are_slerped(reference, swaying_clip):
    frame = reference.at(torch.tensor([(40 + 0.25) / 50], dtype=torch.float64))
    clip = swaying_clip
    pairs = [(clip.qpos[:, 3:7], frame.qpos[0, 3:7].numpy())]
    pairs += [(clip.body_quat_w[:, i], frame.body_quat_w[0, i].numpy()) for i in range(27)]
    for quats, value in pairs:
        whole = angle_between(quats[40], quats[41])
        assert np.linalg.norm(value) == pytest.approx(1, abs=1e-6)
        assert angle_between(quats[40], value) == pytest.approx(0.25 * whole, abs=1e-4)


def test_rotations_of_a_coarse_clip_agree_with_resampling(robot, swaying_clip):
    """At 5 Hz the steps are large enough to tell slerp from linear interpolation."""
    coarse = resample(swaying_clip, 5.0, robot)
    fine = resample(coarse, 50.0, robot)
    frame = Reference(coarse).at(torch.arange(fine.num_frames, dtype=torch.float64) / 50)
    np.testing.assert_allclose(frame.qpos.numpy(), fine.qpos, atol=1e-5)
    np.testing.assert_allclose(frame.body_quat_w[:, 0].numpy(), fine.body_quat_w[:, 0], atol=1e-5)


def test_look_up_returns_memory_of_its_own(reference):
    index = torch.tensor([3, 4])
    before = reference.frame(index).qpos.clone()
    reference.frame(index).qpos.zero_()
    assert torch.equal(reference.frame(index).qpos, before)


def test_attributes(reference):
    assert (reference.fps, reference.num_frames, reference.duration_s) == (50.0, 101, 2.0)
