"""Verdicts on the paper's claims, from studies whose truth is known."""

import dataclasses

import numpy as np
import pytest
from studies import level, make_study

from analysis.report.claims import CLAIMS, PAPER_CONTROL_STEPS, Claim, Finding, Verdict, findings
from analysis.report.evidence import Evidence, prediction_limits, seed_noise
from analysis.study import Study, StudyError
from tlr_exp import keys

UPPER = "Upper-body tracking error falls against the static reward, averaged over training."
SEARCH = "The weight search costs little of an iteration."


def at_paper_size(study: Study) -> Study:
    """The same curves as if each run had taken the paper's control steps."""
    runs = study.runs.assign(control_steps=PAPER_CONTROL_STEPS)
    return dataclasses.replace(study, runs=runs)


def study_with(effect: float, seeds: int = 5, noise: float = 0.01, spread: float = 0.005) -> Study:
    generator = np.random.default_rng(0)
    return make_study(generator, seeds=range(seeds), effect=effect, noise=noise, seed_spread=spread)


def judge(study: Study, statement: str) -> tuple[Claim, Finding]:
    return next(pair for pair in findings(Evidence(study)) if pair[0].statement == statement)


@pytest.mark.parametrize(
    ("effect", "verdict"),
    [(0.10, Verdict.REPRODUCED), (-0.10, Verdict.NOT_REPRODUCED), (0.0, Verdict.CANNOT_SAY)],
)
def test_improvement_is_judged_by_its_interval_over_seeds(effect: float, verdict: Verdict) -> None:
    _, finding = judge(at_paper_size(study_with(effect)), UPPER)
    assert finding.verdict is verdict


def test_the_number_beside_the_paper_is_the_true_improvement() -> None:
    _, finding = judge(study_with(0.10, noise=1e-4, spread=1e-4), UPPER)
    assert finding.ours.startswith("+10.0")


def test_runs_smaller_than_the_papers_are_described_and_never_judged() -> None:
    for _, finding in findings(Evidence(study_with(0.10))):
        assert finding.verdict is Verdict.CANNOT_SAY
        assert finding.reason.startswith("At this scale: ")


def test_a_single_seed_says_nothing_of_an_improvement() -> None:
    _, finding = judge(at_paper_size(study_with(0.10, seeds=1)), UPPER)
    assert finding.verdict is Verdict.CANNOT_SAY
    assert "seed" in finding.reason


def test_overhead_is_the_share_of_the_search_in_the_iteration() -> None:
    """0.2 s of 5.075 s are 3.9 %, below the paper's 8.7 %."""
    _, finding = judge(at_paper_size(study_with(0.0, noise=1e-4, spread=1e-4)), SEARCH)
    assert "3.9 % of an iteration" in finding.ours
    assert finding.verdict is Verdict.REPRODUCED


def test_final_weights_are_compared_with_the_papers() -> None:
    """Weights that end at 0.92 with a little scatter agree with 0.92, those at 0.2 do not."""
    statement = "The weight of dof_pos_limits ends high."
    for value, verdict in ((0.92, Verdict.REPRODUCED), (0.2, Verdict.NOT_REPRODUCED)):
        curves = {keys.WEIGHT_PREFIX + keys.DOF_POS_LIMITS: level(value)}
        generator = np.random.default_rng(1)
        study = make_study(generator, {"fixed": {}, "gwo": curves}, noise=0.01, seed_spread=0.01)
        assert judge(at_paper_size(study), statement)[1].verdict is verdict


def test_terms_that_are_not_in_use_are_named() -> None:
    study = study_with(0.0)
    curves = study.curves.drop(columns=keys.WEIGHT_PREFIX + keys.DOF_POS_LIMITS)
    _, finding = judge(
        dataclasses.replace(study, curves=curves), "The weight of dof_pos_limits ends high."
    )
    assert finding.ours == "not in this reward"


def test_a_study_of_one_arm_is_refused() -> None:
    with pytest.raises(StudyError, match="one arm only"):
        Evidence(make_study(np.random.default_rng(0), arms=("gwo",)))


def test_every_claim_names_its_source() -> None:
    assert all("Fig" in claim.source for claim in CLAIMS)


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
