"""Verdicts on the paper's claims, from studies whose truth is known."""

import dataclasses
import re

import numpy as np
import pytest
from studies import level, make_study, rise, with_starts

from analysis.data.study import Study, StudyError
from analysis.report.evidence import Evidence
from analysis.report.judging.claims import CLAIMS, Claim, findings
from analysis.report.judging.judges import PAPER_CONTROL_STEPS, Finding
from analysis.report.judging.verdicts import Verdict
from tlr_exp import keys

UPPER = "Upper-body tracking error falls against the static reward, averaged over training."
NEAR_ONE = ("ang_vel_xy", "lin_vel_z", "dof_pos_limits", "dof_vel_limits")
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


def test_claims_are_judged_at_any_size_whose_policies_track() -> None:
    """The same curves as above, of runs a million times smaller than the paper's."""
    _, finding = judge(study_with(0.10), UPPER)
    assert finding.verdict is Verdict.REPRODUCED


def test_policies_that_do_not_track_say_nothing_of_those_that_do() -> None:
    """They survive a tenth of the motion, and their errors fall by a straight line to the end.

    From 0.25 by 0.2 over training: 0.04 in the last fifth, 58.5 % of the 0.0683 in its middle.
    """
    falling = {
        "eval/survival": level(0.1),
        keys.TRAIN_UPPER_BODY_ERROR: lambda progress: 0.25 - 0.2 * progress,
    }
    generator = np.random.default_rng(0)
    arms = {"fixed": falling, "gwo": falling}
    study = make_study(generator, arms, noise=0.001, seed_spread=0.002)
    judged = {claim.statement: finding for claim, finding in findings(Evidence(study))}
    for claim in CLAIMS:
        if claim.of_tracking:
            assert judged[claim.statement].verdict is Verdict.CANNOT_SAY
    reason = judged["The two-layered arm's episodes stay above 200 control steps."].reason
    assert "do not track yet, 10\u00a0% (static) and 10\u00a0% (two-layered (GWO))" in reason
    assert "of the motion is survived without noise" in reason
    found = re.search(r"Upper-body error static -([\d.]+)\u00a0% \[.*?\], p = ([\d.e-]+)", reason)
    assert float(found.group(1)) == pytest.approx(58.5, abs=1)
    assert float(found.group(2)) < 1e-3
    assert judged[SEARCH].verdict is Verdict.REPRODUCED  # not about tracking


def test_a_gap_that_closes_before_another_training_is_over_is_no_verdict() -> None:
    """The two-layered error falls from 0.2 towards the static one's 0.1, which has settled."""
    curves = {keys.TRAIN_UPPER_BODY_ERROR: rise(0.3, 0.09, rate=2.0)}
    settled = {keys.TRAIN_UPPER_BODY_ERROR: level(0.1)}
    generator = np.random.default_rng(0)
    study = make_study(generator, {"fixed": settled, "gwo": curves}, noise=0.01, seed_spread=0.005)
    _, finding = judge(study, UPPER)
    assert finding.verdict is Verdict.CANNOT_SAY
    assert "static arm is better: the 95 % interval over seeds is below zero" in finding.reason
    assert "; but the gap closes: upper-body error of two-layered (GWO)" in finding.reason
    # Where both fall alike the verdict stands, however fast they fall.
    alike = {keys.TRAIN_UPPER_BODY_ERROR: rise(0.45, 0.15, rate=2.0)}
    less = {keys.TRAIN_UPPER_BODY_ERROR: rise(0.3, 0.1, rate=2.0)}
    study = make_study(generator, {"fixed": less, "gwo": alike}, noise=0.01, seed_spread=0.005)
    assert judge(study, UPPER)[1].verdict is Verdict.NOT_REPRODUCED


def test_at_first_is_a_fifth_of_a_whole_training_and_all_of_an_early_one() -> None:
    """Static tracks better by 0.05 m in iterations 1 to 12 of 60, and by nothing from 13 on.

    In a training whose policies track, the first fifth counts: 0.05 m. In one that ends before they
    do, all of it lies within the paper's first 49 million control steps: 12 / 60 of 0.05 m.
    """
    statement = "At first the static arm has the smaller upper-body error."
    study = study_with(0.0, noise=1e-6, spread=1e-6)
    curves = study.curves.copy()
    later = (curves["iteration"] <= 12) & (curves["arm"] == "gwo")
    curves[keys.TRAIN_UPPER_BODY_ERROR] = 0.1 + curves["seed"] * 1e-5 + 0.05 * later
    study = dataclasses.replace(study, curves=curves)
    assert judge(study, statement)[1].ours.startswith("static better by +0.0500 ")
    curves["eval/survival"] = np.where(curves["eval/survival"].isna(), np.nan, 0.1)
    _, finding = judge(dataclasses.replace(study, curves=curves), statement)
    assert finding.ours.startswith("static better by +0.0100 ")
    assert "the whole training lies within the 49 million steps" in finding.ours
    assert finding.verdict is Verdict.REPRODUCED


@pytest.mark.parametrize(
    ("shift", "verdict"),
    [
        (-20.0, Verdict.REPRODUCED),
        (20.0, Verdict.NOT_REPRODUCED),
        (0.0, Verdict.CANNOT_SAY),
    ],
)
def test_latency_is_judged_by_the_roll_outs(shift: float, verdict: Verdict) -> None:
    study = with_starts(study_with(0.0), np.random.default_rng(1), shift={"latency_ms": shift})
    _, finding = judge(study, "The two-layered policy lags less behind its reference.")
    assert finding.verdict is verdict
    assert "4 roll-outs a run" in finding.ours


def test_a_single_seed_says_nothing_of_an_improvement() -> None:
    _, finding = judge(at_paper_size(study_with(0.10, seeds=1)), UPPER)
    assert finding.verdict is Verdict.CANNOT_SAY
    assert "seed" in finding.reason


def test_overhead_is_the_share_of_the_search_in_the_iteration() -> None:
    """0.2 s of 5.075 s are 3.9 %, below the paper's 8.7 %."""
    study = study_with(0.0, noise=1e-4, spread=1e-4)
    curves = study.curves.drop(columns="time/evaluate_s")
    _, finding = judge(at_paper_size(dataclasses.replace(study, curves=curves)), SEARCH)
    assert "3.9 % of an iteration" in finding.ours
    assert finding.verdict is Verdict.REPRODUCED


def test_overhead_leaves_out_the_evaluations() -> None:
    """60 iterations of 5.075 s, 6 of them with 2 s of evaluation: 12 of 60 * 5.075 - 12 = 292.5 s.

    Of all 304.5 s they would be 3.9 %.
    """
    _, finding = judge(study_with(0.0, noise=1e-4, spread=1e-4), SEARCH)
    assert "4.1 % of an iteration without its evaluation" in finding.ours


def test_final_weights_are_compared_with_the_papers() -> None:
    """Weights that end at 0.92 with a little scatter agree with 0.92, those at 0.2 do not."""
    statement = "The weight of dof_pos_limits ends high."
    for value, verdict in ((0.92, Verdict.REPRODUCED), (0.2, Verdict.NOT_REPRODUCED)):
        curves = {keys.WEIGHT_PREFIX + "dof_pos_limits": level(value)}
        generator = np.random.default_rng(1)
        study = make_study(generator, {"fixed": {}, "gwo": curves}, noise=0.01, seed_spread=0.01)
        assert judge(at_paper_size(study), statement)[1].verdict is verdict


def test_runs_that_agree_with_everything_reproduce_nothing() -> None:
    """Five runs that end at 0, 0.25, ... 1 scatter as random weights do.

    Mean 0.5, s = sqrt(5/32) = 0.395, t_4 = 2.776: one more run is expected from 0.5 - 1.20 to
    0.5 + 1.20, so it may be 0.92 as well as 0.5.
    """
    study = study_with(0.0)
    weight = keys.WEIGHT_PREFIX + "dof_pos_limits"
    curves = study.curves.copy()
    curves.loc[curves["arm"] == "gwo", weight] = curves["seed"] / 4
    study = at_paper_size(dataclasses.replace(study, curves=curves))
    _, finding = judge(study, "The weight of dof_pos_limits ends high.")
    assert finding.verdict is Verdict.CANNOT_SAY
    assert "from -0.70 to 1.70" in finding.reason


def test_one_low_weight_is_not_outweighed_by_three_high_ones() -> None:
    """1, 1, 1 and 0.6 have the mean 0.9, but not each ends near 0.9."""
    ends = zip(NEAR_ONE, (1.0, 1.0, 1.0, 0.6), strict=True)
    curves = {keys.WEIGHT_PREFIX + name: level(value) for name, value in ends}
    generator = np.random.default_rng(1)
    study = make_study(generator, {"fixed": {}, "gwo": curves}, noise=0.001, seed_spread=0.001)
    _, finding = judge(at_paper_size(study), "Four of the six weights end high.")
    assert finding.verdict is Verdict.NOT_REPRODUCED
    assert f"{NEAR_ONE[3]}: one more run is expected from 0.60" in finding.reason


def test_single_runs_that_may_be_no_better_do_not_reproduce_an_improvement() -> None:
    """An improvement of 7 % that differs by some 5 % from seed to seed: 7 ± 2.8 * 1.1 * 7."""
    study = at_paper_size(study_with(0.07, spread=0.05))
    _, finding = judge(study, "Upper-body error of a single run.")
    assert finding.verdict is Verdict.CANNOT_SAY
    assert "no improvement alike" in finding.reason


def test_first_part_of_training_is_counted_in_iterations() -> None:
    """Of 60 iterations, the first 20 % end at 12, though the length is known from 11 on only.

    Static is longer by 50 steps in iterations 11 and 12, and equally long from 13 on.
    """
    study = study_with(0.0, noise=1e-6, spread=1e-6)
    curves = study.curves.copy()
    early, static = curves["iteration"] <= 12, curves["arm"] == "fixed"
    wobble = curves["seed"] * 1e-3
    curves[keys.EPISODE_LENGTH] = 100.0 + wobble + 50.0 * (early & static)
    curves.loc[curves["iteration"] <= 10, keys.EPISODE_LENGTH] = np.nan
    study = at_paper_size(dataclasses.replace(study, curves=curves))
    _, finding = judge(study, "At first the static arm has the longer episodes.")
    assert finding.ours.startswith("static longer by +50.0 ")
    assert finding.verdict is Verdict.REPRODUCED


def test_curves_that_are_all_the_same_have_no_p_value() -> None:
    study = study_with(0.0)
    curves = study.curves.assign(**{keys.TRAIN_UPPER_BODY_ERROR: 0.1})
    _, finding = judge(dataclasses.replace(study, curves=curves), UPPER)
    assert finding.ours.startswith("+0.0\u00a0%;")
    assert finding.ours.endswith("+0.0 %, p = n/a")


def test_terms_that_are_not_in_use_are_named() -> None:
    study = study_with(0.0)
    curves = study.curves.drop(columns=keys.WEIGHT_PREFIX + "dof_pos_limits")
    _, finding = judge(
        dataclasses.replace(study, curves=curves), "The weight of dof_pos_limits ends high."
    )
    assert finding.ours == "not in this reward"


def test_a_study_of_one_arm_is_refused() -> None:
    with pytest.raises(StudyError, match="one arm only"):
        Evidence(make_study(np.random.default_rng(0), arms=("gwo",)))


def test_every_claim_names_its_source() -> None:
    assert all("Fig" in claim.source for claim in CLAIMS)
