"""A clip in the fewest bytes from which an evaluation reads the same numbers."""

import dataclasses

import numpy as np
import torch

from tlr_exp.motion.checks import ARRAYS
from tlr_exp.motion.clip import MotionClip
from tlr_exp.motion.reference import Reference

_WHOLE = ("qpos", "body_quat_w")


def small_clip(clip: MotionClip) -> MotionClip:
    """The clip with values of float32, which compress well: a reference holds no more of them.

    ``qpos`` keeps every digit, as it is the motion that all else is derived from, and so do all
    quaternions, because they are normalised when a clip is read, in float64. Where the reference
    would differ all the same, the clip is returned as it is.
    """
    arrays = {
        name: getattr(clip, name).astype(np.float32).astype(np.float64)
        for name in ARRAYS
        if name not in _WHOLE
    }
    small = dataclasses.replace(clip, **arrays)
    return small if same_reference(small, clip) else clip


def same_reference(one: MotionClip, other: MotionClip) -> bool:
    """Whether training and evaluation see the same bits in both clips."""
    if (one.fps, one.num_frames) != (other.fps, other.num_frames):
        return False
    frames = torch.arange(one.num_frames)
    pairs = zip(Reference(one).frame(frames), Reference(other).frame(frames), strict=True)
    return all(torch.equal(left, right) for left, right in pairs)
