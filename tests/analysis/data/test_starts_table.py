"""Roll-outs from start phases: read, checked, exported and read again without a digit lost."""

import dataclasses
import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from studies import load_study, make_study, with_starts, write_run_directories

from analysis.commands.export import main as export
from analysis.data.starts import measures_in, of_runs, parse_starts, starts_beside
from analysis.data.study import Study, StudyError
from analysis.data.tables import from_tables, write_tables
from tlr_exp.commands.evaluate.start_tables import MeasuredRun, csv_of


@pytest.fixture
def study() -> Study:
    made = make_study(np.random.default_rng(0), seeds=range(2), iterations=4)
    return with_starts(made, np.random.default_rng(1), phases=3)


def text(*rows: str) -> bytes:
    return "\n".join(["run,arm,start_phase,survival,latency_ms,ended_by", *rows]).encode()


def test_columns_of_numbers_are_measures_and_texts_are_not() -> None:
    starts = parse_starts(text("a,gwo,0.0,1.0,12.5,fell", "a,gwo,0.5,0.25,,completed"), "x.csv")
    assert measures_in(starts) == ["survival", "latency_ms"]
    assert starts["latency_ms"].isna().tolist() == [False, True]


def test_the_csv_of_tlr_evaluate_is_read_whatever_measures_it_has(tmp_path: Path) -> None:
    """Written by the code that writes it, with the measures that this version has."""
    from tlr_exp.commands.evaluate import start_tables

    start = dict.fromkeys(start_tables.OF_THE_START, 0.5) | {"terms": {"ang_vel_xy": 0.125}}
    run = MeasuredRun("a", "gwo", 0, "gym_motion", 407, "native", [start])
    (tmp_path / "starts-1.csv").write_bytes(csv_of([run]))
    starts = parse_starts((tmp_path / "starts-1.csv").read_bytes(), "starts-1.csv")
    assert starts["reward_term/ang_vel_xy"].tolist() == [0.125]
    assert starts["start_phase"].tolist() == [0.5]
    assert "upper_body_error_m" in measures_in(starts)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"run,survival\na,1\n", "the column start_phase is missing"),
        (text("a,gwo,0.5,1,1,x", "a,gwo,0.5,1,1,x"), "start phase 0.5 of a is there twice"),
        (text("a,gwo,,1,1,x", "a,gwo,0.5,1,1,x"), "lacks its run or its start phase"),
        (text("a,gwo,soon,1,1,x"), "start_phase holds soon; it must be a number"),
        (text("a,gwo,0.5,inf,1,x"), "survival is infinite"),
        (b"", "is no table"),
    ],
)
def test_damaged_tables_are_refused_by_name(content: bytes, message: str) -> None:
    with pytest.raises(StudyError, match=rf"^my\.csv: .*{message}"):
        parse_starts(content, "my.csv")


def test_of_several_files_the_one_of_most_starts_counts(tmp_path: Path) -> None:
    run, sweep = tmp_path / "study" / "run", tmp_path / "study" / "sweeps" / "five-1"
    for folder in (run, sweep):
        folder.mkdir(parents=True)
    assert starts_beside(run) is None
    for number in (4, 16):
        (tmp_path / "study" / f"starts-{number}.csv").touch()
    for place in (tmp_path / "study", run, sweep):
        assert starts_beside(place) == tmp_path / "study" / "starts-16.csv"


def test_runs_without_roll_outs_and_unequal_phases_are_noted(study: Study) -> None:
    names = list(study.runs.index)
    fewer = study.starts[study.starts["run"] != names[0]]
    fewer = fewer.drop(index=fewer.index[0])
    starts, notes = of_runs([fewer], names)
    assert list(dict.fromkeys(starts["run"])) == names[1:]
    assert notes == (
        f"without roll-outs from start phases: {names[0]}",
        "the roll-outs of the runs start from different phases: 2, 3 a run",
    )


def test_roll_outs_of_unknown_runs_make_no_study(study: Study) -> None:
    with pytest.raises(StudyError, match=r"^starts: nobody is not among the runs$"):
        dataclasses.replace(study, starts=study.starts.assign(run="nobody", start_phase=range(12)))


def test_an_exported_study_keeps_them_to_the_last_digit(study: Study, tmp_path: Path) -> None:
    write_tables(study, tmp_path / "out")
    again = from_tables(tmp_path / "out")
    pd.testing.assert_frame_equal(again.starts, study.starts, check_exact=True)
    kept = pd.read_csv(tmp_path / "out" / "starts.csv")
    assert kept.columns[:3].tolist() == ["run", "arm", "seed"]
    path = tmp_path / "out" / "starts.csv"
    path.write_bytes(path.read_bytes().replace(b"gwo", b"GWO"))
    with pytest.raises(StudyError, match=r"starts\.csv: is damaged or was changed"):
        from_tables(tmp_path / "out")


def test_a_table_that_was_put_beside_an_exported_study_is_taken(
    study: Study, tmp_path: Path
) -> None:
    write_tables(dataclasses.replace(study, starts=pd.DataFrame()), tmp_path / "out")
    assert from_tables(tmp_path / "out").starts.empty
    study.starts.to_csv(tmp_path / "out" / "starts.csv", index=False)
    assert len(from_tables(tmp_path / "out").starts) == len(study.starts)


def test_the_export_takes_what_lies_beside_the_runs(study: Study, tmp_path: Path, capsys) -> None:
    runs = tmp_path / "runs" / "five"
    write_run_directories(study, runs)
    study.starts.to_csv(runs / "starts-3.csv", index=False)
    assert export([str(runs), "-o", str(tmp_path / "out")]) == 0
    assert "roll-outs from start phases: 12" in capsys.readouterr().out
    assert json.loads((tmp_path / "out" / "manifest.json").read_text())["roll_outs"] == 12
    again = load_study([tmp_path / "out"])
    pd.testing.assert_frame_equal(again.starts, study.starts, check_exact=True)
    # Chosen anew from its runs, an exported study keeps its roll-outs, too.
    assert len(load_study([tmp_path / "out"], seeds="common").starts) == 12
    few = study.starts.groupby("run").head(1)
    few.to_csv(tmp_path / "few.csv", index=False)
    assert len(load_study([tmp_path / "out"], starts=tmp_path / "few.csv").starts) == 4
