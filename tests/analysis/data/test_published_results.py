"""The published study: its tables are whole, and docs/results.md says what they hold."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from analysis.data.tables import from_tables
from analysis.measures.endpoints import area_under_curve, tail_mean
from analysis.measures.rollouts import same_phase
from tlr_exp import keys

ROOT = Path(__file__).parents[3]
PAGE = (ROOT / "docs" / "results.md").read_text()
BODIES = (("upper", keys.TRAIN_UPPER_BODY_ERROR), ("lower", keys.TRAIN_LOWER_BODY_ERROR))


def cells(digits: int, *samples) -> str:
    """Mean and standard deviation of each sample as the page writes them."""
    texts = (f"{np.mean(each):.{digits}f} ± {np.std(each, ddof=1):.{digits}f}" for each in samples)
    return " | ".join(texts)


@pytest.fixture(scope="module")
def study():
    return from_tables(ROOT / "results" / "laptop")


def test_five_finished_seeds_of_both_arms(study):
    assert study.arms == ("fixed", "gwo")
    assert study.seeds("fixed") == study.seeds("gwo") == (0, 1, 2, 3, 4)
    assert study.is_finished
    assert (study.runs["control_steps"] == 407 * 512 * 24).all()


@pytest.mark.parametrize(("body", "metric"), BODIES)
@pytest.mark.parametrize(
    ("when", "endpoint"), [("last 20 %", tail_mean), ("whole training", area_under_curve)]
)
def test_the_page_has_the_errors_of_the_tables(study, body, metric, when, endpoint):
    _, at, static = study.matrix(metric, "fixed")
    adaptive = study.matrix(metric, "gwo")[2]
    row = cells(4, endpoint(static, at), endpoint(adaptive, at))
    assert f"| {body}-body error, {when} (m) | {row} |" in PAGE


def test_the_page_has_the_roll_outs_of_the_table():
    starts = pd.read_csv(ROOT / "results" / "laptop" / "starts.csv")
    assert (starts.groupby(["arm", "seed"]).size() == 16).all()
    survival = starts.groupby(["arm", "seed"])["survival"].mean()
    row = cells(3, survival["fixed"], survival["gwo"])
    assert f"| survival (share of the way to the end) | {row} |" in PAGE


@pytest.mark.parametrize("body", ["upper", "lower"])
def test_the_page_compares_upright_roll_outs_of_the_same_seed_and_phase(study, body):
    """By pandas from the CSV alone, and as the report does it."""
    starts = pd.read_csv(ROOT / "results" / "laptop" / "starts.csv")
    table = starts.pivot(index=["seed", "start_phase"], columns="arm")
    both = table[(table["upright"] == 1).all(axis=1)]
    means = both[f"{body}_body_error_m"].groupby("seed").mean()
    row = cells(4, means["fixed"], means["gwo"])
    assert f"| {body}-body error, both upright (m) | {row} |" in PAGE
    assert f"{len(both)} of {len(table)}" in PAGE
    found = same_phase(study, f"{body}_body_error_m", "gwo")
    np.testing.assert_allclose(found.baseline, means["fixed"])
    np.testing.assert_allclose(found.treatment, means["gwo"])


def test_the_page_says_whose_objective_it_is_and_when_the_gap_was_there(study):
    _, at, static = study.matrix(keys.OBJECTIVE_BEFORE, "fixed")
    adaptive = study.matrix(keys.OBJECTIVE_BEFORE, "gwo")[2]
    told = (
        f"J at weights 1 is {adaptive.mean():.1f} on average over training in the two-layered arm"
    )
    assert f"{told} ({static.mean():.1f} in the static arm" in PAGE
    middle = (at >= 50) & (at <= 75)

    def ratio(metric):
        means = [study.matrix(metric, arm)[2][:, middle].mean() for arm in ("gwo", "fixed")]
        return means[0] / means[1] - 1

    upper, lower = (f"{100 * ratio(metric):.0f} %" for _, metric in BODIES)
    assert f"errors are {upper} (upper body) and {lower} (lower\n  body) larger" in PAGE
    assert f"differ by {100 * ratio('ppo/action_std'):.1f} %" in PAGE
