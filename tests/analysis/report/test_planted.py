"""Studies whose truth is known: planted effects are found, and nothing is called nothing."""

import dataclasses
import json
from collections import Counter

import numpy as np
import pytest
from scipy import stats
from studies import TERMS, make_study, with_starts

from analysis.data.study import Study
from analysis.report.answer import improvements, position
from analysis.report.cells import MISSING
from analysis.report.comparison_tables import area_table
from analysis.report.comparison_tables import tests_table as table_of_tests
from analysis.report.evidence import Evidence
from analysis.report.judging.judges import less_latency
from analysis.report.judging.verdicts import Verdict
from analysis.report.outcomes import (
    lower_layer_outcomes,
    same_phase_outcomes,
    tracking_outcomes,
)
from analysis.statistics.significance import holm
from tlr_exp import keys

COSTS = {keys.REWARD_TERM_PREFIX + term: 0.5 for term in TERMS}
SHIFT = {"upper_body_error_m": 0.002}


@pytest.fixture(scope="module")
def bare() -> Study:
    """Five seeds of both arms, with all penalties of the lower layer, and no roll-outs yet."""
    study = make_study(np.random.default_rng(0), iterations=4, effect=0.0)
    configs = [json.loads(text) for text in study.runs["config"]]
    for config in configs:
        config["reward"]["optimizing"] = dict.fromkeys(TERMS, -1.0)
    runs = study.runs.assign(config=[json.dumps(config) for config in configs])
    return dataclasses.replace(study, runs=runs)


def planted(bare: Study, **effects) -> Evidence:
    generator = np.random.default_rng(3)
    return Evidence(
        with_starts(bare, generator, 16, seed_spread=0.01, phase_spread=0.02, **effects)
    )


def test_a_cost_that_is_halved_is_found_in_every_term_and_in_the_sum(bare: Study) -> None:
    evidence = planted(bare, factor=COSTS)
    found = lower_layer_outcomes(evidence)
    assert [outcome.metric for outcome in found] == ["lower_layer_cost", *COSTS]
    assert (holm([outcome.unpaired.t_test.p_value for outcome in found]) < 0.05).all()
    improvement = found[0].unpaired.relative_improvement
    assert improvement.low < 0.5 < improvement.high
    assert improvement.high - improvement.low < 0.1


def test_an_error_that_is_shifted_by_two_millimetres_is_found_and_no_other(bare: Study) -> None:
    evidence = planted(bare, shift=SHIFT)
    found = tracking_outcomes(evidence)
    p_values = holm([outcome.unpaired.t_test.p_value for outcome in found])
    told = {outcome.metric for outcome, p in zip(found, p_values, strict=True) if p < 0.05}
    assert told == set(SHIFT)
    (shifted,) = [outcome for outcome in found if outcome.metric in SHIFT]
    assert shifted.unpaired.difference.low < 0.002 < shifted.unpaired.difference.high
    paired = same_phase_outcomes(evidence)[0].paired
    assert paired.difference.low < 0.002 < paired.difference.high
    assert paired.t_test.p_value < 0.05


def test_nothing_is_called_something_no_more_often_than_stated(bare: Study) -> None:
    """By what the report says: a whole table of tests, its sentence, its verdict on a claim."""
    generator, num_studies, alarms = np.random.default_rng(4), 80, Counter()
    for _ in range(num_studies):
        evidence = Evidence(with_starts(bare, generator, phases=2))
        tests = table_of_tests(evidence, tracking_outcomes(evidence))
        adjusted = [row[tests.header.index("Welch t, Holm")] for row in tests.rows]
        sentence = position(*improvements(evidence, evidence.rollouts))
        alarms["tests"] += any(float(p) <= 0.05 for p in adjusted if p != MISSING)
        alarms["tracking"] += sentence.startswith(("tracks better", "tracks worse"))
        alarms["cost"] += sentence.endswith(("at less cost", "at more cost"))
        alarms["claim"] += less_latency(evidence).verdict is not Verdict.CANNOT_SAY
    # Three binomial standard errors of 80 studies at 5 % are 7.3 %.
    assert max(alarms.values()) <= (0.05 + 0.073) * num_studies, alarms


def test_the_table_has_the_p_values_of_scipy(bare: Study) -> None:
    evidence = planted(bare, shift=SHIFT)
    rows = {row[0]: row for row in table_of_tests(evidence, tracking_outcomes(evidence)).rows}
    runs, starts = evidence.study.runs, evidence.study.starts
    means = starts.groupby("run")["upper_body_error_m"].mean()
    first, second = (means[runs.index[runs["arm"] == arm]] for arm in ("fixed", "gwo"))
    p_value = stats.ttest_ind(first, second, equal_var=False).pvalue
    shown = rows["Upper-body error"][1]
    assert float(shown) == pytest.approx(p_value, rel=0.06, abs=5e-4)


@pytest.mark.parametrize(
    ("effects", "words"),
    [
        ({"factor": COSTS}, "tracks as well (at most 5 % worse) and moves at less cost"),
        ({"shift": {"upper_body_error_m": 0.02}}, "tracks worse and moves at the same cost"),
        (
            {"shift": {"upper_body_error_m": -0.01, "reward_term/lin_vel_z": 9.0}},
            "tracks better and moves at more cost",
        ),
        ({}, "tracks as well (at most 5 % worse) and moves at the same cost"),
    ],
)
def test_tracking_and_lower_layer_are_told_apart(bare: Study, effects: dict, words: str) -> None:
    evidence = planted(bare, **effects)
    assert position(*improvements(evidence, evidence.rollouts)).startswith(words)


def test_not_told_apart_is_not_as_well(bare: Study) -> None:
    """Seeds that scatter by a third leave open whether an arm is more than 5 % worse."""
    study = with_starts(bare, np.random.default_rng(5), seed_spread=0.33)
    evidence = Evidence(study)
    assert "cannot be told apart in tracking" in position(
        *improvements(evidence, evidence.rollouts)
    )


def test_area_grows_where_the_cost_is_halved_and_where_nothing_is_planted_it_does_not(
    bare: Study,
) -> None:
    halved = area_table(planted(bare, factor=COSTS))
    assert float(halved.rows[0][4]) == pytest.approx(2 / 252, abs=5e-4)
    assert float(area_table(planted(bare)).rows[0][4]) > 0.05
