"""Reference: frames are the clip's."""

import numpy as np
import pytest
import torch

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


def test_look_up_returns_memory_of_its_own(reference):
    index = torch.tensor([3, 4])
    before = reference.frame(index).qpos.clone()
    reference.frame(index).qpos.zero_()
    assert torch.equal(reference.frame(index).qpos, before)


def test_attributes(reference):
    assert (reference.fps, reference.num_frames) == (50.0, 101)
