"""tlr-evaluate --disturb: what is measured, written and resumed; arms side by side."""

import csv
import io
import json
import shutil

import pytest

from tlr_exp.commands import evaluate
from tlr_exp.records.directory import FINISHED
from tlr_exp.records.run_directory import RunDirectory

GRID = ["--disturb", "delay=40", "mass=1.5+friction=0.2", "--starts", "2", "--jobs", "1"]
LABELS = ["none", "delay=40ms", "friction=0.2+mass=1.5"]


@pytest.fixture
def study_folder(untrained_run, tmp_path):
    """Two finished runs of two arms."""
    for name, method in (("a", "fixed"), ("b", "gwo")):
        shutil.copytree(untrained_run, tmp_path / "study" / name)
        RunDirectory.open(tmp_path / "study" / name).set_status(FINISHED, tags={"method": method})
    return tmp_path / "study"


def rows_of(path):
    return list(csv.DictReader(io.StringIO(path.read_text())))


def test_every_run_is_measured_under_every_disturbance_and_once(study_folder, capfd):
    command = [str(study_folder), *GRID]
    assert evaluate.main(command) == 0
    said = capfd.readouterr().out
    assert "6 evaluations, of which 0 are already measured" in said
    rows = rows_of(study_folder / "disturbed-2.csv")
    assert [(row["run"], row["disturbance"]) for row in rows] == [
        (run, label) for run in "ab" for label in LABELS for _ in range(2)
    ]
    assert (study_folder / "disturbed-2.png").stat().st_size > 10_000
    # The same policy, seed and disturbances: the same bits. And each disturbance changes something.
    errors = {
        (row["run"], row["disturbance"]): row["lower_body_error_m"]
        for row in rows
        if float(row["start_phase"]) == 0.0
    }
    for label in LABELS:
        assert errors["a", label] == errors["b", label]
    assert len({errors["a", label] for label in LABELS}) == 3

    # Again, one record gone: it alone is measured, and comes out the same.
    record = study_folder / "a" / "eval" / "000005-native-2starts-delay-40ms.json"
    before = record.read_bytes()
    assert json.loads(before)["disturbance"] == "delay=40ms"
    record.unlink()
    assert evaluate.main(command) == 0
    said = capfd.readouterr().out
    assert "6 evaluations, of which 5 are already measured" in said
    assert "disturbed-2.csv holds the same already" in said
    assert record.read_bytes() == before

    # Another grid is another table, which is not written over this one.
    assert evaluate.main([str(study_folder), "--disturb", "kp=0.5", *GRID[3:]]) == 2
    assert "disturbed-2.csv exists; --force replaces it" in capfd.readouterr().err


def test_of_one_run_the_table_is_among_its_evaluations(study_folder, capfd):
    run = study_folder / "b"
    assert evaluate.main([str(run), "--disturb", "noise=asap", "--starts", "2"]) == 0
    (checkpoint,) = (run / "checkpoints").glob("000005.pt")  # the one that was chosen
    said = capfd.readouterr().out
    assert evaluate.main([str(checkpoint), "--disturb", "noise=asap", "--starts", "2"]) == 0
    assert f"{run / 'eval' / 'disturbed-2.csv'} holds the same" in capfd.readouterr().out
    another = shutil.copy(checkpoint, checkpoint.with_stem("000004"))
    assert evaluate.main([str(another), "--disturb", "noise=asap", "--starts", "2"]) == 2
    assert "disturbed-2.csv exists; --force replaces it" in capfd.readouterr().err
    assert not list((run / "eval").glob("000004*"))  # and before anything is measured
    rows = rows_of(run / "eval" / "disturbed-2.csv")
    assert [row["disturbance"] for row in rows] == ["none", "none", "noise=asap", "noise=asap"]
    assert "noise=asap" in said


def test_a_picture_that_lies_there_without_a_table_is_kept(study_folder, tmp_path, capfd):
    picture = tmp_path / "results.png"
    picture.write_bytes(b"mine")
    table = tmp_path / "results.csv"
    command = [str(study_folder / "a"), "--disturb", "kp=0.5", "--starts", "2", "-o", str(table)]
    assert evaluate.main(command) == 2
    assert "results.png exists; --force replaces it" in capfd.readouterr().err
    assert picture.read_bytes() == b"mine"
    assert not table.exists()
    assert evaluate.main([*command, "--force"]) == 0
    assert picture.read_bytes().startswith(b"\x89PNG")
    picture.write_bytes(b"of the table")  # beside its table it is the command's own
    assert evaluate.main(command) == 0
    assert picture.read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--disturb", "pusch=1"], "'pusch=1' is no disturbance; allowed"),
        (["--disturb", "push=1", "--strip"], "--disturb is for numbers: leave out --strip"),
        (["--disturb", "push=1", "--view"], "--disturb is for numbers: leave out --strip, --view"),
        (["--starts", "2", "--view"], "--starts is for numbers: leave out --strip, --view"),
        (["--disturb", "push=1", "--video"], "no --video"),
        (["--disturb", "push=1", "--starts", "0"], "--starts is 0"),
    ],
)
def test_what_cannot_be_is_refused_before_anything_is_measured(
    study_folder, capsys, arguments, words
):
    assert evaluate.main([str(study_folder / "a"), *arguments]) == 2
    assert words in capsys.readouterr().err
    assert not (study_folder / "a" / "eval").exists()


def test_an_engine_that_cannot_is_named_before_anything_is_measured(study_folder, capsys):
    disturbances = ["friction=0.5", "push=1", "kd=2+mass=1.1"]
    command = [str(study_folder / "a"), "--physics", "mjx", "--disturb", *disturbances]
    assert evaluate.main(command) == 1
    said = capsys.readouterr().err
    refused = "--disturb friction=0.5 mass=1.1+kd=2"
    assert f"--physics mjx cannot do {refused}; --physics native can" in said
