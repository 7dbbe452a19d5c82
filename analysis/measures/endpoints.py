"""One number per seed from its learning curve: what ``analysis.statistics`` compares.

Curves are [num_seeds, num_points] and finite, ``iterations`` [num_points] says when the points were
measured: positive and increasing, not necessarily every one (evaluations are made every few
iterations).
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tlr_exp.errors import UserError

Array = NDArray[np.float64]

TAIL_SHARE = 0.2


def tail_mean(curves: ArrayLike, iterations: ArrayLike, *, share: float = TAIL_SHARE) -> Array:
    """Mean over the last ``share`` of training: the iterations after (1 - share) of the last one.

    Of 1000 iterations, those from 801 to 1000.

    Raises:
        ValueError: shapes that do not fit, values that are not finite, a share outside (0, 1].
    """
    values, times = _checked(curves, iterations)
    if not 0 < share <= 1:
        raise UserError(f"the share of training must lie in (0, 1], got {share}")
    # The tolerance keeps (1 - 0.2) * 15 from including iteration 12 by rounding.
    start = (1 - share) * times[-1]
    return values[:, times > start + 1e-9 * times[-1]].mean(axis=1)


def area_under_curve(curves: ArrayLike, iterations: ArrayLike) -> Array:
    """Mean over training: the area by the trapezoidal rule over the range of iterations.

    In units of the metric; of a single point, its value.

    Raises:
        ValueError: shapes that do not fit, or values that are not finite.
    """
    values, times = _checked(curves, iterations)
    if times.size == 1:
        return values[:, 0]
    return np.trapezoid(values, times, axis=1) / (times[-1] - times[0])


def final_value(curves: ArrayLike, iterations: ArrayLike) -> Array:
    """The last point: of an ``eval/`` metric, the last deterministic evaluation.

    That is the mean over ``scale.evaluate_starts`` roll-outs, in earlier runs one from phase 0.

    Raises:
        ValueError: shapes that do not fit, or values that are not finite.
    """
    values, _ = _checked(curves, iterations)
    return values[:, -1]


def iterations_to_reach(
    curves: ArrayLike,
    iterations: ArrayLike,
    level: float,
    *,
    smaller_is_better: bool,
    window: int = 1,
) -> Array:
    """The first iteration at which the smoothed curve is at ``level`` or better; NaN if never.

    Smoothed by the mean of the last ``window`` points, so that a lucky iteration does not count;
    only full windows do, and the iteration given is the last of the window.

    Raises:
        ValueError: shapes that do not fit, values or a level that are not finite, a window that is
            not in 1 ... num_points.
    """
    values, times = _checked(curves, iterations)
    if not 1 <= window <= times.size:
        raise UserError(f"the window must be between 1 and the {times.size} points, got {window}")
    if not np.isfinite(level):
        raise UserError(f"the level must be a finite number, got {level}")
    windows = np.lib.stride_tricks.sliding_window_view(values, window, axis=1)
    smoothed = windows.mean(axis=-1)
    reached = smoothed <= level if smaller_is_better else smoothed >= level
    first = times[window - 1 :][reached.argmax(axis=1)]
    return np.where(reached.any(axis=1), first, np.nan)


def _checked(curves: ArrayLike, iterations: ArrayLike) -> tuple[Array, Array]:
    values = np.asarray(curves, dtype=np.float64)
    times = np.asarray(iterations, dtype=np.float64)
    if values.ndim != 2 or values.size == 0 or times.shape != values.shape[1:]:
        raise UserError(
            "curves must be [num_seeds, num_points] and iterations [num_points], got shapes "
            f"{values.shape} and {times.shape}"
        )
    if not np.isfinite(values).all():
        raise UserError("curves must be finite: choose iterations at which every seed was measured")
    if times[0] <= 0 or (np.diff(times) <= 0).any():
        raise UserError("iterations must be positive and increasing")
    return values, times
