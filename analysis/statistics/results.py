"""Results that the statistics give back, and checks of what they are given.

Something that the data cannot give (a t-test of one seed, the interval of a constant) is not an
error: its numbers are NaN and ``reason`` says why. Data that must be wrong (NaN, no seed at all,
unequal numbers of paired seeds) raise ``ValueError``.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tlr_exp.errors import UserError

Array = NDArray[np.float64]

# A spread below this share of the largest value is rounding, not variation.
ROUNDING = 1e-12
# Labelings are enumerated up to this number and drawn beyond it: eight seeds against eight are
# exact.
EXACT_LABELINGS = 20_000
DRAWN_LABELINGS = 9_999


@dataclass(frozen=True)
class SignificanceTest:
    """A two-sided test; a t or a difference is positive where treatment exceeds baseline."""

    name: str
    statistic: float
    p_value: float
    reason: str = ""  # why the p-value is NaN


@dataclass(frozen=True)
class Interval:
    """An estimate and its confidence interval."""

    estimate: float
    low: float
    high: float
    confidence: float
    method: str
    reason: str = ""  # why the limits are NaN


def undefined_test(name: str, reason: str) -> SignificanceTest:
    """A test that these data do not allow."""
    return SignificanceTest(name, np.nan, np.nan, reason)


def undefined_interval(estimate: float, confidence: float, method: str, reason: str) -> Interval:
    """An interval that these data do not allow; the estimate may still be known."""
    return Interval(estimate, np.nan, np.nan, confidence, method, reason)


def checked_sample(values: ArrayLike, name: str) -> Array:
    """One finite number per seed, as float64 [num_seeds].

    Raises:
        ValueError: not one-dimensional, empty, or not finite.
    """
    array = np.asarray(values, dtype=np.float64)
    if array.ndim != 1 or array.size == 0:
        raise UserError(f"{name} must be one number per seed, [num_seeds], got shape {array.shape}")
    _check_finite(array, name)
    return array


def checked_samples(
    baseline: ArrayLike, treatment: ArrayLike, *, paired: bool = False
) -> tuple[Array, Array]:
    """Both arms as float64; if paired, element i of both belongs to the same seed.

    Raises:
        ValueError: as :func:`checked_sample`, or unequal numbers of paired seeds.
    """
    first, second = checked_sample(baseline, "baseline"), checked_sample(treatment, "treatment")
    if paired and first.size != second.size:
        raise UserError(
            f"a paired comparison needs the same seeds in both arms, got {first.size} of baseline "
            f"and {second.size} of treatment"
        )
    return first, second


def checked_curves(values: ArrayLike, name: str) -> Array:
    """One finite curve per seed, as float64 [num_seeds, num_iterations].

    Raises:
        ValueError: not two-dimensional, empty, or not finite.
    """
    array = np.asarray(values, dtype=np.float64)
    if array.ndim != 2 or array.size == 0:
        raise UserError(
            f"{name} must be one curve per seed, [num_seeds, num_iterations], got shape "
            f"{array.shape}"
        )
    _check_finite(array, name)
    return array


def checked_confidence(confidence: float) -> float:
    """The confidence level, a share.

    Raises:
        ValueError: not between 0 and 1.
    """
    if not 0.0 < confidence < 1.0:
        raise UserError(f"confidence must lie between 0 and 1 (0.95 for 95 %), got {confidence}")
    return confidence


def is_constant(values: Array, scale: float | None = None) -> bool:
    """Whether values [n] differ by no more than rounding of numbers as large as ``scale``."""
    largest = float(np.abs(values).max()) if scale is None else scale
    return float(np.ptp(values)) <= ROUNDING * largest


def single_seed_problem(baseline: Array, treatment: Array) -> str:
    """Why seeds cannot be compared, if an arm has a single one; empty if both have more."""
    for name, sample in (("baseline", baseline), ("treatment", treatment)):
        if sample.size < 2:
            return f"{name} has one seed, so its spread is unknown"
    return ""


def spread_problem(baseline: Array, treatment: Array, *, paired: bool = False) -> str:
    """Why a t statistic of these samples is undefined; empty if it is defined."""
    alone = single_seed_problem(baseline, treatment)
    if alone:
        return alone
    if paired:
        scale = float(max(np.abs(baseline).max(), np.abs(treatment).max()))
        if is_constant(treatment - baseline, scale):
            return "the differences of the paired seeds do not vary"
    elif is_constant(baseline) and is_constant(treatment):
        return "neither arm varies from seed to seed"
    return ""


def _check_finite(array: Array, name: str) -> None:
    wrong = array.size - int(np.isfinite(array).sum())
    if wrong:
        raise UserError(f"{name} must be finite, but {wrong} of {array.size} values are not")
