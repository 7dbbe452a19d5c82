"""What cannot be compared is refused with names; what may differ is noted."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from run_records import FIXED, GWO, changed, index, lines_of, records, set_in, with_setting
from studies import make_study

from analysis.data.check import checked
from analysis.data.runs import RunRecord, records_of


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
    assert first == "no run is left to compare"
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


# --- motions ---------------------------------------------------------------------------------
def of_two_motions():
    walk = [replace(with_setting(run, "env.motion", "walk"), motion="walk") for run in records()]
    return [*records(), *(replace(run, name=f"walk-{run.name}") for run in walk)]


def test_runs_of_several_motions_are_not_arms_of_each_other():
    (line,) = lines_of(of_two_motions(), ("optimizer", "env"))
    assert line == "runs of several motions cannot be compared: gym_motion, walk"


def test_one_motion_of_several_is_a_study():
    study = checked(of_two_motions(), ("optimizer", "env"), motion="walk")
    assert study.arms == ("fixed", "gwo")
    assert set(study.runs["motion"]) == {"walk"}


def test_an_unknown_motion_is_told_with_those_there_are():
    (line,) = lines_of(of_two_motions(), ("optimizer", "env"), motion="dance")
    assert line == "no run has the motion 'dance'; there are gym_motion, walk"
