"""Jumps taken out: single ones are bridged by a curve, shaking is filtered without delay."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicHermiteSpline
from scipy.signal import butter, sosfiltfilt

from tlr_exp.motion.checks import ROOT_QUAT
from tlr_exp.motion.quality.floor import stretches
from tlr_exp.motion.quality.jumps import position_acceleration, rotation_acceleration
from tlr_exp.motion.quality.limits import LIMITS, Limit
from tlr_exp.motion.quaternions import angle_between, continuous, normalised
from tlr_exp.robot.spec import RobotSpec

# A jump is replaced by a curve over at most this time, over as few frames as will do.
MAX_BRIDGE_S = 0.4
# Where more than this share of a channel's frames jumps, it shakes and is filtered as a whole.
SHAKING_SHARE = 0.2
# Cut-off frequencies that are tried, the mildest first; people's own motion is mostly below 6 Hz.
CUTOFFS_HZ = (12.0, 10.0, 8.0, 6.0)


@dataclass(frozen=True)
class Channel:
    """What jumps as one: the root's position, its orientation (as quaternions), or a joint.

    ``acceleration`` gives [T-2] from values [T, n]; ``project`` brings values back to where they
    belong (unit quaternions); ``change`` says how far two sets of values are apart, [T].
    """

    name: str
    columns: slice
    limit: Limit
    acceleration: Callable[[np.ndarray, float], np.ndarray]
    project: Callable[[np.ndarray], np.ndarray]
    change: Callable[[np.ndarray, np.ndarray], np.ndarray]
    unit: str


def _apart(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    return np.linalg.norm(first - second, axis=1)


def _same(values: np.ndarray) -> np.ndarray:
    return values


def channels(spec: RobotSpec) -> tuple[Channel, ...]:
    """The root's position, its orientation, and each joint."""
    return (
        Channel(
            *("the root's position", slice(0, 3), LIMITS["root jump"]),
            *(position_acceleration, _same, _apart, "m"),
        ),
        Channel(
            *("the root's orientation", ROOT_QUAT, LIMITS["root rotation jump"]),
            *(rotation_acceleration, normalised, angle_between, "rad"),
        ),
        *(
            Channel(
                *(name, slice(i, i + 1), LIMITS["joint jump"]),
                *(position_acceleration, _same, _apart, "rad"),
            )
            for i, name in enumerate(spec.joint_names, start=7)
        ),
    )


def mend_jumps(qpos: np.ndarray, fps: float, spec: RobotSpec) -> tuple[np.ndarray, list[str]]:
    """Take out of [T, 30] what is beyond the ``fail`` limit of a jump, down to the ``ok`` limit.

    Returns:
        Configurations, and in words what was changed.
    """
    mended, changes = qpos.copy(), []
    mended[:, ROOT_QUAT] = continuous(qpos[:, ROOT_QUAT])
    for channel in channels(spec):
        before = mended[:, channel.columns].copy()
        after, how = mend(before, channel, fps)
        if how:
            mended[:, channel.columns] = after
            size = channel.change(before, after).max()
            changes.append(f"{channel.name}: {how}, changed by at most {size:.3f} {channel.unit}")
    return (mended, changes) if changes else (qpos, [])


def mend(values: np.ndarray, channel: Channel, fps: float) -> tuple[np.ndarray, str]:
    """One channel [T, n] without its jumps, and how it was done; empty where there was no jump."""
    size = channel.acceleration(values, fps)
    runs = _bad_runs(size, channel.limit)
    if not runs:
        return values, ""
    if (size > channel.limit.ok).mean() > SHAKING_SHARE:
        return _filter(values, channel, fps)
    done, places = values.copy(), []
    for start, end in runs:
        first, last = _bridge(done, channel, fps, start, end)
        places.append(f"{first / fps:.2f}-{last / fps:.2f} s")
    return done, f"bridged {', '.join(places)} by a smooth curve"


def _bad_runs(acceleration: np.ndarray, limit: Limit) -> list[tuple[int, int]]:
    """Frames (first, one past the last) around accelerations [T-2] beyond ``fail``."""
    runs: list[tuple[int, int]] = []
    for start, end in stretches(acceleration > limit.ok):
        if acceleration[start:end].max() <= limit.fail:
            continue
        # Row i belongs to frame i + 1. Curves need a few good frames between them.
        if runs and start + 1 - runs[-1][1] < 4:
            runs[-1] = (runs[-1][0], end + 1)
        else:
            runs.append((start + 1, end + 1))
    return runs


def _bridge(
    values: np.ndarray, channel: Channel, fps: float, start: int, end: int
) -> tuple[int, int]:
    """Replace frames start to end of ``values`` in place, and as many around as it takes.

    Returns:
        The first and the last frame replaced.
    """
    original, frames = values.copy(), len(values)
    for _ in range(max(1, round(MAX_BRIDGE_S * fps / 2))):
        values[:] = original
        values[start:end] = channel.project(_curve(original, start, end))
        around = slice(max(0, start - 3), end + 2)
        if channel.acceleration(values, fps)[around].max(initial=0.0) <= channel.limit.ok:
            break
        start, end = max(0, start - 1), min(frames, end + 1)
    return start, end - 1


def _curve(values: np.ndarray, start: int, end: int) -> np.ndarray:
    """Values for the frames start to end: a cubic that goes on as the frames around it do."""
    left, right, inside = start - 1, end, np.arange(start, end)
    if left < 0 and right >= len(values):
        return values[start:end]
    if left < 0:
        return values[right] + (inside - right)[:, None] * _slope(values, right, 1)
    if right >= len(values):
        return values[left] + (inside - left)[:, None] * _slope(values, left, -1)
    ends, slopes = [left, right], [_slope(values, left, -1), _slope(values, right, 1)]
    return CubicHermiteSpline(ends, values[ends], slopes)(inside)


def _slope(values: np.ndarray, frame: int, side: int) -> np.ndarray:
    """Change per frame at ``frame``, from frames on one side (-1 before, 1 after) alone."""
    near, far = frame + side, frame + 2 * side
    if 0 <= far < len(values):
        return side * (4 * values[near] - values[far] - 3 * values[frame]) / 2
    if 0 <= near < len(values):
        return side * (values[near] - values[frame])
    return np.zeros_like(values[frame])


def _filter(values: np.ndarray, channel: Channel, fps: float) -> tuple[np.ndarray, str]:
    """A Butterworth low-pass, forwards and backwards, with the mildest cut-off that is enough."""
    cutoffs = [cutoff for cutoff in CUTOFFS_HZ if cutoff < 0.45 * fps]
    done, how = values, ""
    for cutoff in cutoffs:
        sections = np.asarray(butter(2, cutoff, fs=fps, output="sos"))
        padding = min(9, len(values) - 1)
        done = channel.project(sosfiltfilt(sections, values, axis=0, padlen=padding))
        how = f"filtered below {cutoff:g} Hz without delay"
        if channel.acceleration(done, fps).max() <= channel.limit.ok:
            break
    return done, how
