"""Arms under disturbances: what is read from the CSV, and the tables of a report."""

from pathlib import Path

import numpy as np
import pytest
from studies import load_study, make_study, write_run_directories

from analysis.data.disturbed import disturbed_runs, read_disturbed
from analysis.data.study import StudyError
from analysis.report.disturbance import disturbance_section

HEADER = "run,arm,seed,disturbance,start_phase,survival,upper_body_error_m,lower_body_error_m"


def write(path: Path, rows: list[tuple]) -> Path:
    path.write_text("\n".join([HEADER, *(",".join(map(str, row)) for row in rows)]) + "\n")
    return path


def rows_of(runs, disturbances=("none", "push=0.5")) -> list[tuple]:
    """Two starts a run; errors are run number + 10 * disturbance number, upper and twice lower."""
    return [
        (run, "x", 0, name, phase, 1.0 if phase == 0.0 or which == 0 else 0.5, error, 2 * error)
        for number, run in enumerate(runs)
        for which, name in enumerate(disturbances)
        for phase in (0.0, 0.5)
        for error in [number + 10 * which]
    ]


@pytest.fixture
def study():
    return make_study(np.random.default_rng(0), seeds=range(2), iterations=4)


def test_a_study_finds_the_evaluation_beside_its_runs_and_shows_the_arms(study, tmp_path):
    write_run_directories(study, tmp_path)
    names = list(study.runs.index)
    write(tmp_path / "disturbed-2.csv", rows_of(names))
    loaded = load_study([tmp_path])
    (section,) = disturbance_section(loaded)
    success, upper, lower = section.tables
    assert success.header == ("disturbance", "static", "two-layered (GWO)")
    assert [row[0] for row in success.rows] == ["none", "push=0.5"]
    assert success.rows[0][1].startswith("1.00")
    assert success.rows[1][1].startswith("0.50")  # of two starts one failed
    fixed = [number for number, run in enumerate(names) if "fixed" in run]
    mean = float(np.mean(fixed))
    spread = float(np.std(fixed, ddof=1))
    assert upper.rows[0][1] == f"{mean:.4f}\u00a0±\u00a0{spread:.4f}"
    assert upper.rows[1][1] == f"{mean + 10:.4f}\u00a0±\u00a0{spread:.4f}"
    assert lower.rows[0][1].startswith(f"{2 * mean:.4f}")


def test_a_study_without_such_an_evaluation_has_no_such_section(study):
    assert list(disturbance_section(study)) == []


def test_disturbances_that_not_all_runs_have_met_are_left_out(study, tmp_path):
    names = list(study.runs.index)
    rows = rows_of(names)
    frame = read_disturbed(write(tmp_path / "a.csv", rows[:-2]))  # the last run, pushed
    found, notes = disturbed_runs([frame], names)
    assert set(found["disturbance"]) == {"none"}
    assert notes == (
        "left out under disturbances: push=0.5, as these runs have not met them: " + names[-1],
    )
    for tables, runs in (([], names), ([frame], ["another"])):
        nothing, notes = disturbed_runs(tables, runs)
        assert nothing.empty
        assert notes == ()


def test_a_study_says_which_runs_an_evaluation_lacks(study, tmp_path):
    write_run_directories(study, tmp_path)
    first, second, *rest = study.runs.index
    write(tmp_path / "disturbed-2.csv", rows_of(rest))
    loaded = load_study([tmp_path])
    assert list(disturbance_section(loaded)) == []
    (note,) = [note for note in loaded.notes if "disturbances" in note]
    assert note.startswith("left out under disturbances: none, push=0.5, as these runs")
    assert note.endswith(f"{first}, {second}")


def test_damaged_tables_are_refused_by_name(study, tmp_path):
    rows = rows_of(["a"])
    with pytest.raises(StudyError, match=r"b\.csv, push=0\.5: .*0\.5 of a is there twice"):
        read_disturbed(write(tmp_path / "b.csv", [*rows, rows[-1]]))
    (tmp_path / "c.csv").write_text("run,start_phase\na,0.5\n")
    with pytest.raises(StudyError, match="the column disturbance is missing"):
        read_disturbed(tmp_path / "c.csv")
    with pytest.raises(StudyError, match="is no table"):
        read_disturbed(tmp_path / "nothing.csv")
