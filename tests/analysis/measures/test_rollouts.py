"""Measures without noise by run: from roll-outs or evaluations, and paired by seed and phase."""

import dataclasses
import json

import numpy as np
import pandas as pd
import pytest
from studies import STARTS_OF, TERMS, make_study, with_starts

from analysis.data.study import Study
from analysis.measures.rollouts import lower_layer, rollouts, same_phase
from analysis.measures.tradeoff import tradeoff_of
from tlr_exp import keys

COEFFICIENTS = {term: -(index + 1.0) for index, term in enumerate(TERMS)}


@pytest.fixture
def study() -> Study:
    made = make_study(np.random.default_rng(0), seeds=range(3), iterations=20)
    configs = [json.loads(text) for text in made.runs["config"]]
    for config in configs:
        config["reward"]["optimizing"] = COEFFICIENTS
    runs = made.runs.assign(config=[json.dumps(config) for config in configs])
    return dataclasses.replace(made, runs=runs)


def test_cost_is_coefficient_times_raw_value_summed_over_the_terms(study: Study) -> None:
    exact = with_starts(study, np.random.default_rng(1), seed_spread=0.0, phase_spread=0.0)
    found = rollouts(exact, with_terms=True)
    assert found.source == "4 roll-outs a run, without noise"
    by_hand = sum((k + 1) * (0.5 + k) for k in range(len(TERMS)))
    assert found.by_run["lower_layer_cost"].tolist() == pytest.approx([by_hand] * 6)
    assert found.by_run["upper_body_error_m"].tolist() == pytest.approx([0.05] * 6)
    assert (found.by_run["success"] == 1.0).all()


def test_cost_is_that_of_the_baseline_in_every_arm(study: Study) -> None:
    """Other penalties of another arm, and a scale of the baseline's, by hand."""
    configs = [json.loads(text) for text in study.runs["config"]]
    for config, arm in zip(configs, study.runs["arm"], strict=True):
        config["reward"]["optimizing"] = {TERMS[0]: -2.0 if arm == "fixed" else -100.0}
        config["reward"]["penalty_scale"] = 0.5
    runs = study.runs.assign(config=[json.dumps(config) for config in configs])
    assert lower_layer(dataclasses.replace(study, runs=runs)) == {TERMS[0]: 1.0}


def test_tables_without_terms_leave_the_lower_layer_to_the_evaluations(study: Study) -> None:
    curves = study.curves.copy()
    for term in TERMS:
        curves[f"eval/{keys.REWARD_TERM_PREFIX}{term}"] = np.where(
            curves["eval/survival"].isna(), np.nan, 2.0
        )
    starts = with_starts(study, np.random.default_rng(1)).starts
    starts = starts[["run", "start_phase", "survival", "upper_body_error_m", "lower_body_error_m"]]
    both = dataclasses.replace(study, curves=curves, starts=starts)
    assert rollouts(both).source.startswith("4 roll-outs a run")
    found = rollouts(both, with_terms=True)
    assert found.source == "the evaluation during training at iteration 20, without noise"
    assert found.by_run["lower_layer_cost"].tolist() == pytest.approx([2.0 * 21] * 6)


def test_success_is_the_share_of_roll_outs_that_survive_to_the_end(study: Study) -> None:
    starts = with_starts(study, np.random.default_rng(1)).starts
    starts.loc[starts["start_phase"] == 0.0, "survival"] = 0.999
    found = rollouts(dataclasses.replace(study, starts=starts))
    assert found.by_run["success"].tolist() == [0.75] * 6


def test_pairs_are_of_one_seed_and_one_phase() -> None:
    """Static falls from phase 0, which is hard: 0.4 there, and 0.1 from phase 0.5.

    Two-layered has 0.5 and 0.2 and stays upright. Over the upright roll-outs of each arm it would
    be 0.35 against 0.1; from the same phase it is 0.2 against 0.1.
    """
    study = make_study(np.random.default_rng(0), seeds=range(2), iterations=4)
    rows = [
        {"run": run, "start_phase": phase, "upright": up, "upper_body_error_m": error}
        for run, arm in study.runs["arm"].items()
        for phase, up, error in (
            ((0.0, 0.3, 0.4), (0.5, 1.0, 0.1))
            if arm == "fixed"
            else ((0.0, 1.0, 0.5), (0.5, 1.0, 0.2))
        )
    ]
    study = dataclasses.replace(study, starts=pd.DataFrame(rows))
    found = same_phase(study, "upper_body_error_m", "gwo")
    assert (found.pairs, found.out_of, found.seeds) == (2, 4, (0, 1))
    assert found.baseline.tolist() == [0.1, 0.1]
    assert found.treatment.tolist() == [0.2, 0.2]
    assert same_phase(study, "joint_error_rad", "gwo") is None


def test_points_are_cost_and_mean_error_of_every_run(study: Study) -> None:
    planted = with_starts(study, np.random.default_rng(1), seed_spread=0.0, phase_spread=0.0)
    points = tradeoff_of(planted).points
    error = (STARTS_OF["upper_body_error_m"] + STARTS_OF["lower_body_error_m"]) / 2
    assert {arm: each.shape for arm, each in points.items()} == {"fixed": (3, 2), "gwo": (3, 2)}
    assert points["gwo"][:, 1] == pytest.approx([error] * 3)
