"""Curves through keyframe values: twice continuously differentiable and never overshooting."""

from collections.abc import Sequence

import numpy as np
from scipy.interpolate import BPoly


def interpolate(knots: Sequence[tuple[float, float]], times_s: np.ndarray) -> np.ndarray:
    """A channel's value at ``times_s`` [T], given its knots (time in seconds, value).

    Before the first knot and after the last the channel is constant.

    Between two knots the curve is a quintic with zero acceleration at both. Where a channel turns
    or rests its velocity at the knot is zero, which makes the piece a minimum-jerk movement; where
    it goes on in the same direction the curve passes through at the harmonic mean of the two
    neighbouring slopes, which is small enough for the curve to stay between its knots.
    """
    times, levels = np.array(knots, dtype=float).T
    if len(times) == 1:
        return np.full(len(times_s), levels[0])
    slopes = np.diff(levels) / np.diff(times)
    speeds = np.zeros(len(times))
    before, after = slopes[:-1], slopes[1:]
    through = before * after > 0
    total = np.where(through, before + after, 1.0)
    speeds[1:-1] = np.where(through, 2 * before * after / total, 0.0)
    table = np.stack([levels, speeds, np.zeros_like(levels)], axis=1)
    curve = BPoly.from_derivatives(times, table)
    return curve(np.clip(times_s, times[0], times[-1]))


def bump(start_s: float, end_s: float, times_s: np.ndarray) -> np.ndarray:
    """A smooth rise from 0 to 1 and back within [start, end], zero outside; [T].

    Velocity and acceleration vanish at both ends, as they must where a foot leaves the floor.
    """
    part = np.clip((times_s - start_s) / (end_s - start_s), 0.0, 1.0)
    return 64 * part**3 * (1 - part) ** 3
