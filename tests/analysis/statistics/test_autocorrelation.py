"""Autocorrelation against a direct sum, and its time against the closed form of AR(1)."""

import numpy as np
import pytest

from analysis.statistics.autocorrelation import autocorrelation, integrated_time
from analysis.statistics.nulls import ar1_curves
from analysis.statistics.paper import dependence


def ar1(phi: float, num_iterations: int, seed: int = 0) -> np.ndarray:
    return ar1_curves((num_iterations,), phi, 0.0, np.random.default_rng(seed))


def test_autocorrelation_by_hand() -> None:
    # 1 2 3 less their mean: -1 0 1. Squares 2; lag one (-1)(0) + (0)(1) = 0; lag two (-1)(1) = -1.
    np.testing.assert_allclose(autocorrelation([1.0, 2.0, 3.0]), [1.0, 0.0, -0.5], atol=1e-12)


@pytest.mark.parametrize("num_iterations", [2, 3, 64, 101])
def test_autocorrelation_is_the_direct_sum(num_iterations: int) -> None:
    series = np.random.default_rng(1).normal(3.0, 2.0, num_iterations)
    centred = series - series.mean()
    direct = [
        sum(centred[t] * centred[t + lag] for t in range(num_iterations - lag))
        for lag in range(num_iterations)
    ]
    np.testing.assert_allclose(autocorrelation(series), np.array(direct) / direct[0], atol=1e-12)


@pytest.mark.simulation
@pytest.mark.parametrize("phi", [-0.5, 0.0, 0.5, 0.9])
def test_time_of_ar1_is_the_closed_form(phi: float) -> None:
    expected = (1 + phi) / (1 - phi)
    times = [integrated_time(ar1(phi, 20_000, seed)) for seed in range(10)]
    assert np.mean(times) == pytest.approx(expected, rel=0.05)


@pytest.mark.simulation
def test_effective_sample_size_is_what_the_mean_is_worth() -> None:
    # The variance of the mean of curves of variance 1 is 1 / effective sample size.
    curves = ar1_curves((4000, 500), 0.8, 0.0, np.random.default_rng(2))
    worth = 1 / curves.mean(axis=1).var()
    estimated = np.mean([dependence(curve).effective_sample_size for curve in curves[:200]])
    # 9 iterations of 500: some 4 % of bias, for the mean is estimated too.
    assert estimated == pytest.approx(worth, rel=0.1)


def test_independent_values_are_worth_themselves() -> None:
    sizes = [dependence(ar1(0.0, 1000, seed)).effective_sample_size for seed in range(50)]
    assert np.mean(sizes) == pytest.approx(1000, rel=0.05)


def test_alternating_values_are_bounded() -> None:
    # tau >= 1 / log10(1000) = 1 / 3.
    assert integrated_time(np.tile([1.0, -1.0], 500)) == pytest.approx(1 / 3)


def test_a_trend_is_dependence() -> None:
    assert dependence(np.arange(1000.0)).effective_sample_size < 10


@pytest.mark.parametrize(
    ("series", "message"),
    [
        ([1.0], "at least two iterations"),
        ([[1.0, 2.0]], "at least two iterations"),
        ([1.0, np.nan, 2.0], "finite"),
        ([0.1, 0.1, 0.1], "constant"),
    ],
)
def test_what_has_no_autocorrelation_is_refused(series: list, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        autocorrelation(series)
