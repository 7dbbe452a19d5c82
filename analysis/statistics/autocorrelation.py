"""Measures how much neighbouring iterations of a curve depend on each other."""

import numpy as np
from numpy.typing import ArrayLike
from scipy import signal

from analysis.statistics.results import Array, is_constant
from tlr_exp.errors import UserError


def autocorrelation(series: ArrayLike) -> Array:
    """Autocorrelation of a series [num_iterations] at the lags 0, 1, ..., num_iterations - 1.

    rho_k = sum_t (x_t - mean)(x_{t+k} - mean) / sum_t (x_t - mean)^2, by Fourier transform. The sum
    of the numerator has fewer terms at larger lags and is not scaled up for it, which keeps the
    estimate positive definite (Box, Jenkins and Reinsel, Time Series Analysis, section 2.1).

    Raises:
        ValueError: not one-dimensional, fewer than two values, not finite, or constant.
    """
    values = np.asarray(series, dtype=np.float64)
    if values.ndim != 1 or values.size < 2:
        raise UserError(f"a series needs at least two iterations, got shape {values.shape}")
    if not np.isfinite(values).all():
        raise UserError("a series must be finite")
    if is_constant(values):
        raise UserError("a constant series has no autocorrelation")
    centred = values - values.mean()
    covariance = signal.correlate(centred, centred, method="fft")[values.size - 1 :]
    return covariance / covariance[0]


def integrated_time(series: ArrayLike) -> float:
    """Integrated autocorrelation time tau of a series [num_iterations], in iterations.

    tau = 1 + 2 sum_k rho_k: the mean of the series is as uncertain as that of num_iterations / tau
    independent values. For x_t = phi x_{t-1} + noise, tau = (1 + phi) / (1 - phi). The sum ends
    where pairs rho_2k + rho_2k+1 are first negative, since noise follows (initial positive
    sequence; Geyer 1992, Statistical Science 7, 473-483), and the pairs are kept from growing (his
    initial monotone sequence). Below, tau is bounded by 1 / log10(num_iterations) (Vehtari et al.
    2021, Bayesian Analysis 16, 667-718), which alternating series need.

    A series shorter than some fifty tau, or one with a trend, gives an estimate that is too small.

    Raises:
        ValueError: as :func:`autocorrelation`.
    """
    rho = autocorrelation(series)
    num_iterations = rho.size
    pairs = rho[: 2 * (num_iterations // 2)].reshape(-1, 2).sum(axis=1)
    negative = np.flatnonzero(pairs <= 0)
    initial = pairs[: negative[0]] if negative.size else pairs
    tau = 2 * np.minimum.accumulate(initial).sum() - 1 if initial.size else 0.0
    return float(max(tau, 1 / np.log10(max(num_iterations, 10))))
