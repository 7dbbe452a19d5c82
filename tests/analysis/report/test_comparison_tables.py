"""What the tables say of data that do not allow everything."""

import dataclasses

import numpy as np
import pytest
from studies import level, make_study

from analysis.data.study import Study, StudyError
from analysis.report.cells import MISSING
from analysis.report.comparison_tables import curves_table
from analysis.report.comparison_tables import tests_table as table_of_tests
from analysis.report.evidence import Evidence
from analysis.report.outcomes import outcomes
from analysis.report.protocol_tables import protocol_table, units_table
from tlr_exp import keys

LAST = "eval/upper_body_error_m"


def study_of(seeds: int = 3, iterations: int = 20) -> Study:
    generator = np.random.default_rng(0)
    return make_study(generator, seeds=range(seeds), iterations=iterations, evaluate_every=5)


def without(study: Study, metric: str, run: int, iteration: int | None = None) -> Study:
    """The study, of which a run lacks a metric, everywhere or in one iteration."""
    curves = study.curves.copy()
    there = curves["run"] == study.runs.index[run]
    if iteration is not None:
        there &= curves["iteration"] == iteration
    curves.loc[there, metric] = np.nan
    return dataclasses.replace(study, curves=curves)


def test_errors_at_equal_times_since_reset_are_compared_where_runs_have_them() -> None:
    metric = keys.TRAIN_UPPER_BODY_ERROR_AT_EQUAL_AGES
    arms = {"fixed": {metric: level(0.10)}, "gwo": {metric: level(0.09)}}
    random = np.random.default_rng(0)
    study = make_study(random, arms, range(3), 20, seed_spread=0.01, noise=0.01)
    (found,) = [each for each in outcomes(Evidence(study)) if each.metric == metric]
    assert found.endpoint == "last 20 %"
    assert found.unpaired.relative_improvement.estimate == pytest.approx(0.1, abs=0.03)
    assert metric not in [each.metric for each in outcomes(Evidence(study_of()))]


def test_a_metric_that_one_run_never_has_is_left_out_and_said() -> None:
    evidence = Evidence(without(study_of(), LAST, run=0))
    found = outcomes(evidence)
    assert LAST not in [outcome.metric for outcome in found]
    assert len(found) == 8
    note = table_of_tests(evidence, found).note
    assert note.endswith(
        "Without an iteration in which all runs have it: Upper-body error, evaluation."
    )
    with pytest.raises(StudyError, match=f"never in {evidence.study.runs.index[0]}$"):
        evidence.curves(LAST)


def test_an_evaluation_that_is_not_the_last_one_is_named() -> None:
    """Evaluated at 5, 10, 15 and 20; where one run lacks 20, 15 is the last that all have."""
    evidence = Evidence(without(study_of(), LAST, run=4, iteration=20))
    names = [outcome.name for outcome in outcomes(evidence)]
    assert "Upper-body error, evaluation, last that all have, iteration 15" in names
    assert "Lower-body error, evaluation, last" in names


def test_three_seeds_cannot_tell_curves_apart_and_the_table_says_so() -> None:
    """2 of C(6, 3) = 20 labelings are as extreme at least: 0.1."""
    note = curves_table(Evidence(study_of(seeds=3))).note
    assert note.endswith("a p below 0.1: nothing can differ here, whatever the curves.")
    assert "So few" not in curves_table(Evidence(study_of(seeds=4))).note  # 2 of 70


def test_reasons_name_the_measures_they_hold_for() -> None:
    study = study_of()
    curves = study.curves.copy()
    curves[LAST] = np.where(curves[LAST].isna(), np.nan, 0.1)
    evidence = Evidence(dataclasses.replace(study, curves=curves))
    note = table_of_tests(evidence, outcomes(evidence)).note
    measure = "Upper-body error, evaluation, last"
    assert f"Neither arm varies from seed to seed ({measure})" in note
    assert f"The differences of the paired seeds do not vary ({measure})" in note


def test_a_baseline_without_any_error_is_refused_by_name() -> None:
    study = study_of()
    curves = study.curves.copy()
    curves.loc[curves["iteration"] == 3, keys.TRAIN_UPPER_BODY_ERROR] = 0.0
    with pytest.raises(StudyError, match=r"^train/upper_body_error_m, fixed: .* positive baseline"):
        protocol_table(Evidence(dataclasses.replace(study, curves=curves)))


def test_equal_curves_have_no_protocol_but_no_nan_either() -> None:
    study = study_of()
    curves = study.curves.assign(**{keys.TRAIN_UPPER_BODY_ERROR: 0.1})
    row = protocol_table(Evidence(dataclasses.replace(study, curves=curves))).rows[0]
    assert row == ("Upper-body error", "+0.00\u00a0%", MISSING, "20", MISSING, MISSING)


def test_exact_p_values_are_adjusted_too_and_the_note_says_what_five_seeds_cannot_give() -> None:
    """Nine rows times 2 / 252 are 0.071; six seeds against six can give 9 * 2 / 924 = 0.019."""
    evidence = Evidence(study_of(seeds=5))
    found = outcomes(evidence)
    table = table_of_tests(evidence, found)
    assert table.header[3:5] == ("permutation", "permutation, Holm")
    raw = [outcome.unpaired.permutation_test.p_value for outcome in found]
    # SciPy has Benjamini's procedures only; Holm by hand: the k-th smallest times (9 - k + 1).
    order = np.argsort(raw)
    running = np.maximum.accumulate([(9 - k) * raw[i] for k, i in enumerate(order)])
    by_hand = dict(zip(order, np.minimum(running, 1), strict=True))
    assert [row[4] for row in table.rows] == [f"{by_hand[k]:.3f}" for k in range(9)]
    assert "an exact p of so many seeds is 0.071 at the least: none can fall below 0.05" in (
        table.note
    )
    assert "6 seeds per arm are the fewest that can, which is a reason for ten" in table.note
    six = Evidence(study_of(seeds=6))
    assert "none can fall" not in table_of_tests(six, outcomes(six)).note


def test_units_of_the_papers_p_begin_with_the_seeds_and_end_with_the_iterations() -> None:
    evidence = Evidence(study_of(seeds=5, iterations=60))
    table = units_table(evidence)
    assert [row[1] for row in table.rows] == ["5", "5", "10", "15", "20", "50", "60"]
    assert table.rows[-1][0] == "iterations"
    assert table.rows[0][2:4] == ("108.68", "795.27")
    assert table.rows[-1][4] == protocol_table(evidence).rows[0][2]
