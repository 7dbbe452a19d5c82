"""Where one more run is expected, and how curves scatter: the numbers behind the verdicts."""

import numpy as np
import pytest
from studies import make_study

from analysis.data.study import Study
from analysis.report.evidence import Evidence, prediction_limits, seed_noise
from analysis.statistics.nulls import ar1_curves
from tlr_exp import keys


def test_prediction_limits_by_hand() -> None:
    """Of 1, 2, 3: s = 1, t_2 = 4.3027, so 2 -+ 4.3027 sqrt(4/3) = 2 -+ 4.968."""
    low, high = prediction_limits(np.array([1.0, 2.0, 3.0]))
    assert (low, high) == pytest.approx((-2.968, 6.968), abs=1e-3)


def test_prediction_limits_hold_the_next_value_as_often_as_they_say() -> None:
    generator = np.random.default_rng(2)
    draws = generator.standard_normal((4000, 6))
    inside = 0
    for row in draws:
        low, high = prediction_limits(row[:5])
        inside += low <= row[5] <= high
    # Three binomial standard errors of 4000 draws at 95 % are 1.0 %.
    assert inside / len(draws) == pytest.approx(0.95, abs=0.0104)


def test_limits_of_unshared_seeds_let_both_runs_vary() -> None:
    """Means 10 of 9, 10, 11 and 8 of 7, 8, 8, 9: ratio 0.8, variances 1 and 2/3.

    Parts 0.64 * 1 * (1 + 1/3) = 0.8533 and 2/3 * (1 + 1/4) = 0.8333, together 1.6867; degrees of
    freedom 1.6867^2 / (0.8533^2 / 2 + 0.8333^2 / 3) = 4.777; t = 2.607; half the width is
    2.607 * sqrt(1.6867) / 10 = 0.3386 around 1 - 0.8.
    """
    study = make_study(np.random.default_rng(0), seeds=range(4))
    last = study.runs.index[3]  # of seed 3 of fixed
    curves = study.curves.set_index("run").drop(index=last).reset_index()
    levels = {("fixed", 0): 9, ("fixed", 1): 10, ("fixed", 2): 11}
    levels |= {("gwo", 0): 7, ("gwo", 1): 8, ("gwo", 2): 8, ("gwo", 3): 9}
    curves[keys.TRAIN_UPPER_BODY_ERROR] = [
        float(levels[key]) for key in zip(curves["arm"], curves["seed"], strict=True)
    ]
    evidence = Evidence(Study(study.runs.drop(index=last), curves))
    limits = evidence.improvement_limits(keys.TRAIN_UPPER_BODY_ERROR)
    assert limits == pytest.approx((0.2 - 0.3386, 0.2 + 0.3386), abs=1e-4)


@pytest.mark.parametrize(("rho", "spread"), [(0.8, 0.0), (0.95, 0.0), (0.8, 0.5)])
def test_seed_noise_does_not_take_slow_noise_for_levels(rho: float, spread: float) -> None:
    """The mean of 400 values with rho = 0.8 varies by 0.15 of their spread, with 0.95 by 0.30."""
    generator = np.random.default_rng(4)
    found = [
        seed_noise(*(ar1_curves((5, 400), rho, spread, generator) for _ in range(2)))
        for _ in range(60)
    ]
    between = np.mean([noise.between_seed_sd**2 for noise in found])
    assert between == pytest.approx(spread**2, abs=0.05)
    assert np.mean([noise.autocorrelation for noise in found]) == pytest.approx(rho, abs=0.03)


def test_seed_noise_finds_what_the_curves_were_made_with() -> None:
    generator = np.random.default_rng(3)
    rho, spread = 0.8, 0.5
    shocks = generator.standard_normal((200, 2000)) * np.sqrt(1 - rho**2)
    noise = np.zeros_like(shocks)
    noise[:, 0] = shocks[:, 0] / np.sqrt(1 - rho**2)
    for t in range(1, shocks.shape[1]):
        noise[:, t] = rho * noise[:, t - 1] + shocks[:, t]
    curves = 10.0 + spread * generator.standard_normal((200, 1)) + noise
    found = seed_noise(curves)
    assert found.autocorrelation == pytest.approx(rho, abs=0.01)
    assert found.between_seed_sd == pytest.approx(spread, abs=0.08)
