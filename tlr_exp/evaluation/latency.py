"""How far a motion is behind its reference in time."""

from dataclasses import dataclass

import numpy as np

MAX_LAG_S = 0.4
MOVING_RAD = 0.01  # a joint whose standard deviation over the motion is smaller stands still
MIN_CORRELATION = 0.5


@dataclass(frozen=True)
class Latency:
    """Delay of the motion behind its reference; ``ms`` is None where it cannot be told.

    ``correlation`` is the mean correlation of the joints at that delay, ``reason`` why ``ms`` is
    None (empty otherwise).
    """

    ms: float | None
    correlation: float | None
    reason: str = ""


def latency(
    reference: np.ndarray, motion: np.ndarray, dt_s: float, max_lag_s: float = MAX_LAG_S
) -> Latency:
    """Delay of ``motion`` behind ``reference``, by cross-correlation; positive: the motion lags.

    At each whole-step delay the correlation coefficient of each joint is taken over the steps that
    overlap, and averaged over the joints that move; a parabola through the highest value and its
    neighbours gives the fraction of a step.

    Args:
        reference, motion: joint positions [T, joints], rad.
        dt_s: time between rows.
        max_lag_s: longest delay looked for, either way.
    """
    lags = round(max_lag_s / dt_s)
    if len(reference) < 2 * lags + 2:
        return Latency(None, None, f"the motion is shorter than {2 * max_lag_s:g} s")
    moving = np.minimum(reference.std(axis=0), motion.std(axis=0)) > MOVING_RAD
    if not moving.any():
        return Latency(None, None, "no joint moves in both reference and motion")
    curve = np.array(
        [
            _correlation(reference[:, moving], motion[:, moving], lag)
            for lag in range(-lags, lags + 1)
        ]
    )
    peak = int(np.argmax(curve))
    if curve[peak] < MIN_CORRELATION:
        return Latency(
            None, float(curve[peak]), f"the joints' correlation stays below {MIN_CORRELATION:g}"
        )
    if peak in (0, 2 * lags):
        return Latency(None, float(curve[peak]), f"no delay within {max_lag_s:g} s fits best")
    before, top, after = curve[peak - 1 : peak + 2]
    bend = before - 2.0 * top + after
    fraction = 0.5 * (before - after) / bend if bend < 0.0 else 0.0
    return Latency(1000.0 * dt_s * (peak - lags + float(fraction)), float(top))


def _correlation(reference: np.ndarray, motion: np.ndarray, lag: int) -> float:
    """Mean over joints of the correlation of reference[t] with motion[t + lag]."""
    steps = len(reference) - abs(lag)
    a = reference[max(0, -lag) :][:steps]
    b = motion[max(0, lag) :][:steps]
    a, b = a - a.mean(axis=0), b - b.mean(axis=0)
    norm = np.sqrt((a * a).sum(axis=0) * (b * b).sum(axis=0))
    return float(((a * b).sum(axis=0) / np.maximum(norm, 1e-12)).mean())
