"""The policies in results/policies: each is small, nameless, and does what its manifest says."""

import json
from pathlib import Path

import pytest

from tlr_exp.commands.evaluate import choose
from tlr_exp.evaluation.result import mean_metrics
from tlr_exp.evaluation.starts import evaluate_starts
from tlr_exp.records.places import plain_values
from tlr_exp.records.run_directory import RunDirectory

FOLDER = Path(__file__).parents[2] / "results" / "policies"
FOUND = sorted(path.parent for path in FOLDER.glob("*/manifest.json"))
NONE = pytest.param(None, marks=pytest.mark.skip(reason="results/policies holds no policy yet"))
EVALUATIONS = "eval"

each_policy = pytest.mark.parametrize(
    "policy", FOUND or [NONE], ids=lambda path: path.name if path else "none"
)


@each_policy
def test_it_tracks_its_motion_as_well_as_it_did_in_training(policy):
    choice = choose(policy)
    _, each = evaluate_starts(choice, choice.settings.scale.evaluate_starts)
    now = mean_metrics([start.result for start in each])
    then = RunDirectory.open(policy).manifest["policy"]["evaluation"]
    assert now["eval/unstable_steps"] == 0
    # Other machines round otherwise, and contacts amplify it.
    assert now["eval/survival"] == pytest.approx(then["eval/survival"], abs=0.1)
    for name in ("eval/upper_body_error_m", "eval/lower_body_error_m"):
        assert now[name] == pytest.approx(then[name], rel=0.25)


@each_policy
def test_it_is_small_and_names_no_place(policy):
    files = [path for path in policy.rglob("*") if path.is_file()]
    kept = [path for path in files if EVALUATIONS not in path.relative_to(policy).parts]
    assert sum(path.stat().st_size for path in kept) < 2.5e6
    run = RunDirectory.open(policy)
    assert plain_values(run.config) == run.config
    assert plain_values(run.manifest) == run.manifest
    assert "host" not in json.dumps(run.manifest)
