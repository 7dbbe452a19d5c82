"""What cannot be compared is refused with names; what may differ is noted."""

import copy
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd
import pytest
from studies import make_study

from analysis.check import checked
from analysis.runs import RunRecord, records_of
from analysis.settings import NOT_LEARNED, arm_labels, flat
from analysis.study import StudyError
from tlr_exp.config import NOT_IDENTITY

FIXED = "demo-fixed-seed"
GWO = "demo-gwo-seed"


def records(arms: Sequence[str] = ("fixed", "gwo"), seeds: int = 3) -> list[RunRecord]:
    study = make_study(np.random.default_rng(0), arms, range(seeds), iterations=4)
    return records_of(study)


def index(runs: Sequence[RunRecord], start: str) -> int:
    (found,) = [number for number, run in enumerate(runs) if run.name.startswith(start)]
    return found


def changed(runs: Sequence[RunRecord], start: str, **changes: Any) -> list[RunRecord]:
    """`runs` with one of them, by the start of its name, changed."""
    number = index(runs, start)
    return [*runs[:number], replace(runs[number], **changes), *runs[number + 1 :]]


def with_setting(run: RunRecord, key: str, value: Any) -> RunRecord:
    config = copy.deepcopy(dict(run.config))
    *parents, last = key.split(".")
    group = config
    for parent in parents:
        group = group.setdefault(parent, {})
    group[last] = value
    return replace(run, config=config)


def set_in(runs: Sequence[RunRecord], start: str, key: str, value: Any) -> list[RunRecord]:
    number = index(runs, start)
    return [*runs[:number], with_setting(runs[number], key, value), *runs[number + 1 :]]


def lines_of(runs: Sequence[RunRecord], *arguments: Any, **choices: Any) -> list[str]:
    with pytest.raises(StudyError) as caught:
        checked(runs, *arguments, **choices)
    return str(caught.value).splitlines()


def test_sound_runs_become_the_study_they_came_from() -> None:
    study = make_study(np.random.default_rng(0), iterations=4)
    again = checked(list(reversed(records_of(study))))
    pd.testing.assert_frame_equal(
        again.runs.sort_index(), study.runs[again.runs.columns].sort_index()
    )
    for arm in study.arms:
        for metric in study.metric_names:
            for part, wanted in zip(
                again.matrix(metric, arm), study.matrix(metric, arm), strict=True
            ):
                np.testing.assert_array_equal(part, wanted)
    assert again.runs["seed"].tolist() == [0, 1, 2, 3, 4] * 2
    assert again.runs["arm"].tolist() == ["fixed"] * 5 + ["gwo"] * 5
    assert again.notes == ()


def test_ignored_settings_are_those_that_training_ignores() -> None:
    assert set(NOT_LEARNED) == set(NOT_IDENTITY)


# --- unfinished ------------------------------------------------------------------------------
@pytest.mark.parametrize(
    ("status", "words"),
    [
        ("running", "still running, or was killed, after 2 of 4 iterations"),
        ("failed", "failed after 2 of 4 iterations"),
        ("interrupted", "interrupted after 2 of 4 iterations"),
    ],
)
def test_unfinished_runs_are_refused_or_taken_with_a_note(status: str, words: str) -> None:
    runs = records()
    run = runs[index(runs, f"{GWO}1")]
    runs = changed(runs, f"{GWO}1", status=status, curve=run.curve.iloc[:2])
    assert lines_of(runs) == [f"{run.name}: {words}"]
    study = checked(runs, allow_unfinished=True)
    assert study.matrix("ppo/kl", "gwo")[1].tolist() == [1, 2]
    assert study.matrix("ppo/kl", "fixed")[1].tolist() == [1, 2, 3, 4]
    assert [note for note in study.notes if run.name in note and words in note]
    assert study.runs.loc[run.name, "control_steps"] == 2 * 8 * 24


def test_a_run_without_any_iteration_is_left_out_of_unfinished_ones() -> None:
    runs = records()
    run = runs[index(runs, f"{GWO}2")]
    runs = changed(runs, f"{GWO}2", status="failed", curve=run.curve.iloc[:0])
    # Seed 2 of the other arm has no partner then, which is a refusal of its own.
    assert lines_of(runs, allow_unfinished=True) == ["arm 'gwo' lacks seed 2, which 'fixed' has"]
    study = checked(runs, allow_unfinished=True, seeds="common")
    assert study.seeds("fixed") == study.seeds("gwo") == (0, 1)
    assert f"{run.name} (failed) was left out: it has no iteration yet" in study.notes


def test_finished_runs_that_lack_iterations_are_refused() -> None:
    runs = records()
    run = runs[index(runs, f"{FIXED}0")]
    runs = changed(runs, f"{FIXED}0", curve=run.curve.drop(index=[1]))
    assert lines_of(runs) == [f"{run.name}: finished, with 1 of 4 iterations missing: 2"]


# --- seeds -----------------------------------------------------------------------------------
def test_seeds_that_an_arm_lacks() -> None:
    runs = records(("fixed", "gwo", "random"))
    runs = [run for run in runs if not run.name.startswith((f"{GWO}1", "demo-random-seed2"))]
    assert lines_of(runs) == [
        "arm 'gwo' lacks seed 1, which 'fixed', 'random' has",
        "arm 'random' lacks seed 2, which 'fixed', 'gwo' has",
    ]
    study = checked(runs, seeds="common")
    assert [study.seeds(arm) for arm in study.arms] == [(0,), (0,), (0,)]
    assert len(study.notes) == 4
    left_out = [run.name for run in runs if run.seed != 0]
    for name in left_out:
        assert len([note for note in study.notes if note.startswith(f"{name} was left out")]) == 1


def test_common_seeds_leave_out_what_is_unfinished() -> None:
    runs = records()
    run = runs[index(runs, f"{GWO}1")]
    runs = changed(runs, f"{GWO}1", status="running", curve=run.curve.iloc[:2])
    study = checked(runs, seeds="common")
    assert study.seeds("gwo") == study.seeds("fixed") == (0, 2)
    fixed = runs[index(runs, f"{FIXED}1")].name
    assert f"{fixed} was left out: arm 'gwo' has not finished seed 1" in study.notes
    note = f"{run.name} was left out: it is still running, or was killed, after 2 of 4 iterations"
    assert note in study.notes


def test_no_common_seed() -> None:
    runs = [run for run in records() if (run.method == "gwo") == (run.seed == 0)]
    first, *rest = lines_of(runs, seeds="common")
    assert first == "no seed has been finished by every arm"
    assert [line.partition(" was left out: arm ")[0] for line in rest] == [run.name for run in runs]


# --- duplicates ------------------------------------------------------------------------------
def twice(status: str = "finished", created_at: str = "2026-02-01") -> list[RunRecord]:
    runs = records()
    again = replace(
        runs[index(runs, f"{GWO}1")],
        name="again",
        run_id="2",
        status=status,
        created_at=created_at,
    )
    return [*runs, again]


def test_two_runs_of_one_seed_are_refused_by_both_names() -> None:
    (line,) = lines_of(twice())
    assert line.startswith("arm 'gwo' has seed 1 2 times: ")
    assert f"{GWO}1" in line
    assert "again (finished, 2026-02-01)" in line


@pytest.mark.parametrize(
    ("status", "created_at", "wins"),
    [
        ("finished", "2026-02-01", True),
        ("finished", "2025-02-01", False),
        ("failed", "2026-02-01", False),
    ],
)
def test_the_newest_finished_run_wins_when_asked(status: str, created_at: str, wins: bool) -> None:
    runs = twice(status, created_at)
    study = checked(runs, duplicates="newest")
    assert len(study.runs) == 6
    assert ("again" in study.runs.index) == wins
    (note,) = study.notes
    loser = runs[index(runs, f"{GWO}1")].name if wins else "again"
    assert note.startswith(f"{loser} (")


def test_one_run_given_twice_and_two_runs_of_one_name() -> None:
    runs = records()
    assert lines_of([*runs, runs[0]]) == [f"{runs[0].name}: was given 2 times"]
    other = replace(runs[0], run_id="other", created_at="2026-03-03")
    (line,) = lines_of([*runs, other])
    assert line.startswith(f"{runs[0].name}: 2 different runs have this name: ")
    assert "other of 2026-03-03" in line


# --- settings --------------------------------------------------------------------------------
def test_settings_that_differ_are_named_with_both_values() -> None:
    runs = set_in(records(), f"{GWO}2", "ppo.gamma", 0.9)
    name, example = runs[index(runs, f"{GWO}2")].name, runs[0].name
    assert lines_of(runs) == [f"{name}: ppo.gamma is 0.9, but 0.99 in {example} and 4 more"]


def test_a_setting_that_one_run_lacks_or_has_besides() -> None:
    runs = set_in(records(), f"{GWO}2", "env.reset_noise.root_pos_m", 0.1)
    (line,) = lines_of(runs)
    assert "env.reset_noise.root_pos_m is 0.1, but absent in" in line


def test_whole_numbers_equal_floats_but_not_texts_and_not_null() -> None:
    runs = [with_setting(run, "ppo.gamma", 1.0) for run in records()]
    assert checked(set_in(runs, f"{GWO}2", "ppo.gamma", 1)).is_finished
    assert len(lines_of(set_in(runs, f"{GWO}2", "ppo.gamma", "1.0"))) == 1
    assert len(lines_of(set_in(runs, f"{GWO}2", "env.robot.mjcf", "null"))) == 1
    assert len(lines_of(set_in(runs, f"{GWO}2", "ppo.hidden_sizes", [512, 256, 64]))) == 1


def test_within_an_arm_the_optimizers_settings_must_agree() -> None:
    runs = set_in(records(), f"{GWO}2", "optimizer.pack_size", 10)
    (line,) = lines_of(runs)
    assert line.startswith(runs[index(runs, f"{GWO}2")].name)
    assert "optimizer.pack_size is 10, but 30 in" in line
    # Between arms of different optimizers they do not: fixed has no pack.
    assert checked(records()).arms == ("fixed", "gwo")


@pytest.mark.parametrize("key", NOT_LEARNED)
def test_settings_that_do_not_change_what_is_learned_may_differ(key: str) -> None:
    runs = set_in(records(), f"{GWO}2", key, 77)
    assert checked(runs).is_finished


def test_thread_counts_and_evaluation_steps_are_noted() -> None:
    runs = set_in(records(), f"{GWO}2", "num_threads", 2)
    (note,) = checked(runs).notes
    name = runs[index(runs, f"{GWO}2")].name
    assert note == f"num_threads differs: 1 in 5 runs; 2 in {name}"


def test_settings_can_be_ignored_by_key_or_group_and_are_noted() -> None:
    runs = set_in(records(), f"{GWO}2", "env.motion", "other/place.npz")
    assert len(lines_of(runs)) == 1
    for key in ("env.motion", "env"):
        (note,) = checked(runs, ignore=[key]).notes
        assert note.startswith("env.motion differs: gym_motion in 5 runs; other/place.npz in ")


def test_all_problems_come_at_once() -> None:
    runs = twice()
    runs = set_in(runs, f"{GWO}2", "ppo.gamma", 0.9)
    runs = changed(runs, f"{FIXED}0", status="failed")
    runs = [run for run in runs if not run.name.startswith(f"{FIXED}1")]
    signs = ("failed after", "2 times", "lacks seed 1", "ppo.gamma")
    lines = lines_of(runs)
    assert len(lines) == len(signs)
    for line, sign in zip(lines, signs, strict=True):
        assert sign in line


# --- arms ------------------------------------------------------------------------------------
THRESHOLDS = ("fixed", "gwo, threshold_share=0.02", "gwo, threshold_share=0.1")
SHARE = "reward.objective.threshold_share"


def test_arms_by_further_keys() -> None:
    study = checked(records(THRESHOLDS), ["optimizer", SHARE])
    assert study.arms == ("fixed, threshold_share=0.1", *THRESHOLDS[1:])
    assert study.baseline == "fixed, threshold_share=0.1"
    assert len(lines_of(records(THRESHOLDS))) > 0


def test_arm_keys_that_do_not_differ_are_not_in_the_label() -> None:
    assert checked(records(), ["optimizer", SHARE, "ppo.gamma"]).arms == ("fixed", "gwo")


def test_arms_without_the_optimizer() -> None:
    runs = [run for run in records(THRESHOLDS) if run.method == "gwo"]
    study = checked(runs, [SHARE])
    assert study.arms == ("threshold_share=0.02", "threshold_share=0.1")
    assert checked(runs, [SHARE], baseline="threshold_share=0.1").arms[0] == "threshold_share=0.1"


def test_labels_of_keys_with_the_same_end_and_of_exchangeable_parts() -> None:
    runs = [with_setting(run, "a.size", run.seed % 2) for run in records(("gwo",), seeds=2)]
    runs = [with_setting(run, "b.size", 5 + run.seed % 2) for run in runs]
    assert arm_labels(runs, ["optimizer", "a.size", "b.size"]) == [
        "gwo, a.size=0, b.size=5",
        "gwo, a.size=1, b.size=6",
    ]
    parts = [with_setting(run, "physics._target_", f"p.Engine{run.seed}") for run in runs]
    assert arm_labels(parts, ["optimizer", "physics"]) == [
        "gwo, physics=Engine0",
        "gwo, physics=Engine1",
    ]


def test_unknown_keys_are_refused_with_the_nearest() -> None:
    assert lines_of(records(), ["optimiser", "threshold_share"], ignore=["zzz"]) == [
        "no run has the configuration key optimiser; did you mean optimizer?",
        f"no run has the configuration key threshold_share; did you mean {SHARE}?",
        "no run has the configuration key zzz",
    ]


def test_flat_configurations() -> None:
    assert flat({"a": {"b": 1, "c": {}}, "d": [1, {"e": 2}], "f": None}) == {
        "a.b": 1,
        "a.c": {},
        "d": [1, {"e": 2}],
        "f": None,
    }


# --- notes -----------------------------------------------------------------------------------
def test_versions_commits_and_machines_are_noted() -> None:
    runs = records()
    packages = {**runs[0].packages, "numpy": "9.9"}
    runs = changed(runs, f"{GWO}0", packages=packages, host="other", commit=f"{'f' * 40}-dirty")
    name = runs[index(runs, f"{GWO}0")].name
    assert checked(runs).notes == (
        f"source revisions differ: 0123456789ab in 5 runs; ffffffffffff in {name}",
        f"made with local changes to the source: {name}",
        f"versions of numpy differ: 2.4.6 in 5 runs; 9.9 in {name}",
        f"machines differ: machine (A Processor) in 5 runs; other (A Processor) in {name}; "
        "wall-clock times of different machines cannot be compared",
    )


def test_no_runs() -> None:
    assert lines_of([]) == ["there is no run"]
