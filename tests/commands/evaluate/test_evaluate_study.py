"""tlr-evaluate --starts on several runs: which are measured, what is written, what is said."""

import csv
import io
import json
import math
import shutil

import pytest
import yaml
from rich.console import Console

from tlr_exp import keys
from tlr_exp.commands import evaluate
from tlr_exp.commands.evaluate.arms import arms_of
from tlr_exp.commands.evaluate.start_tables import MeasuredRun, arms_table, csv_of, runs_in
from tlr_exp.evaluation.records import read_starts
from tlr_exp.records.directory import FAILED, FINISHED
from tlr_exp.records.run_directory import RunDirectory

NAME = "000005-native-2starts.json"


@pytest.fixture
def study_folder(untrained_run, tmp_path):
    """A study of two finished runs, a broken one without a checkpoint, and one that failed."""
    folder = tmp_path / "study"
    made = {"a": FINISHED, "b": FINISHED, "broken": FINISHED, "c": FAILED}
    for name, status in made.items():
        shutil.copytree(untrained_run, folder / name)
        run = RunDirectory.open(folder / name)
        run.set_status(status, tags={"method": "gwo"})
        run.rewrite_config({**run.config, "seed": len(name)})
    shutil.rmtree(folder / "broken" / "checkpoints")
    return folder


def rows_of(path):
    return list(csv.DictReader(io.StringIO(path.read_text())))


def start(phase, survival, latency_ms=None, **terms):
    return {
        **{"start_frame": 0, "start_phase": phase, "duration_s": 2.0, "survival": survival},
        **{"upright": 1.0, "upper_body_error_m": 0.1, "lower_body_error_m": 0.2},
        **{"joint_error_rad": 0.3, "latency_ms": latency_ms, "terms": terms},
    }


def measured_run(name, arm, seed, *each):
    return MeasuredRun(name, arm, seed, "walk", 5, "native", list(each))


# --- the command -----------------------------------------------------------------------------


def test_a_study_is_measured_in_processes_and_what_breaks_is_named(study_folder, capfd):
    command = [str(study_folder), "--starts", "2", "--jobs", "2"]
    assert evaluate.main(command) == 1
    said = capfd.readouterr()
    assert "broken cannot be evaluated" in said.err
    assert "skipped: c is failed" in said.out
    assert "2 runs, of which 0 are already measured" in said.out
    rows = rows_of(study_folder / "starts-2.csv")
    assert [(row["run"], row["start_phase"]) for row in rows] == [
        *(("a", "0.0"), ("a", "0.475")),  # frame 19 of 0 ... 40
        *(("b", "0.0"), ("b", "0.475")),
    ]
    record = json.loads((study_folder / "a" / "eval" / NAME).read_text())
    for row, each in zip(rows, record["starts"]["each"], strict=False):
        assert float(row["upper_body_error_m"]) == each["upper_body_error_m"]
        assert float(row["reward_term/body_pos"]) == each["terms"]["body_pos"]
    assert not (study_folder / "c" / "eval").exists()
    assert [path.name for path in (study_folder / "a" / "eval").iterdir()] == [NAME]

    # Again: nothing is measured, and what is there comes out the same.
    assert evaluate.main(command) == 1
    said = capfd.readouterr()
    assert "2 runs, of which 2 are already measured" in said.out
    assert "starts-2.csv holds the same already" in said.out


def measure_alone(run, starts="2"):
    assert evaluate.main([str(run), "--starts", starts, "--no-video", "--no-pictures"]) == 0


def test_several_runs_of_which_one_is_measured_give_one_table(study_folder, tmp_path, capsys):
    """A run measured alone is not measured again: the table has its numbers."""
    runs = [study_folder / "a", study_folder / "c"]  # a failed run counts if it is named
    for run in runs:
        measure_alone(run)
    output = tmp_path / "several.csv"
    command = [*map(str, runs), "--starts", "2", "-o", str(output)]
    assert evaluate.main(command) == 0
    assert "2 runs, of which 2 are already measured" in capsys.readouterr().out
    assert [row["run"] for row in rows_of(output)] == ["a", "a", "c", "c"]

    record = study_folder / "a" / "eval" / NAME
    record.write_text(record.read_text()[:-50])
    before = output.read_bytes()
    assert evaluate.main(command) == 2
    said = capsys.readouterr()
    assert "a cannot be evaluated" in said.err
    assert "is no whole record of 2 roll-outs" in said.err
    assert f"{output} exists; --force replaces it" in said.err
    assert output.read_bytes() == before
    assert evaluate.main([*command, "--force"]) == 1
    assert [row["run"] for row in rows_of(output)] == ["c", "c"]


def test_a_file_that_would_lack_a_run_is_refused_before_the_run_is_measured(study_folder, capsys):
    output = study_folder / "starts-2.csv"
    output.write_text("something else\n")
    assert evaluate.main([str(study_folder), "--starts", "2"]) == 2
    assert f"{output} exists; --force replaces it" in capsys.readouterr().err
    assert not (study_folder / "a" / "eval").exists()
    assert output.read_text() == "something else\n"


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["RUN", "RUN"], "measured with --starts"),
        (["RUN", "--starts", "0"], "--starts is 0"),
        (["FOLDER", "--starts", "2", "--jobs", "0"], "--jobs is 0"),
        (["RUN", "--starts", "2", "--jobs", "2"], "--jobs is for --starts with several runs"),
        (["FOLDER", "--starts", "2", "--video"], "numbers alone"),
        (["FOLDER", "--starts", "2", "--web"], "--starts is for numbers"),
        (["FOLDER", "--starts", "2", "-o", "x.png"], "should end in .csv"),
        (["FOLDER", "--starts", "2", "-o", "FOLDER/no/x.csv"], "there is no folder"),
        (["FOLDER/empty", "--starts", "2"], "there is no finished run in"),
    ],
)
def test_what_does_not_go_together_is_refused(untrained_run, tmp_path, capsys, arguments, words):
    (tmp_path / "empty").mkdir()
    given = [
        argument.replace("RUN", str(untrained_run)).replace("FOLDER", str(tmp_path))
        for argument in arguments
    ]
    assert evaluate.main(given) == 2
    assert words in capsys.readouterr().err


# --- records ---------------------------------------------------------------------------------


def test_a_record_of_one_roll_out_is_one_start_at_phase_zero(untrained_run, tmp_path):
    command = [str(untrained_run), "--no-video", "--no-pictures", "-o", str(tmp_path)]
    assert evaluate.main(command) == 0
    path = tmp_path / "000005-native.json"
    (only,) = read_starts(path, 1)
    assert only["start_phase"] == 0.0
    assert only["survival"] == json.loads(path.read_text())["survival"]
    with pytest.raises(ValueError, match="no whole record of 2 roll-outs"):
        read_starts(path, 2)


# --- table -----------------------------------------------------------------------------------


def test_every_roll_out_is_a_row_and_what_it_lacks_an_empty_cell():
    runs = [
        measured_run("one", "gwo", 0, start(0.0, 1.0, 25.0, body_pos=0.5), start(0.5, 0.25)),
        measured_run("two", "zero, a=1", 1, start(0.0, 1.0, ang_vel_xy=2.0)),
    ]
    content = csv_of(runs)
    rows = list(csv.DictReader(io.StringIO(content.decode())))
    assert [row["latency_ms"] for row in rows] == ["25.0", "", ""]
    assert [row["reward_term/body_pos"] for row in rows] == ["0.5", "", ""]
    assert [row["reward_term/ang_vel_xy"] for row in rows] == ["", "", "2.0"]
    assert [row["arm"] for row in rows] == ["gwo", "gwo", "zero, a=1"]
    assert runs_in(content) == {(run.run, str(run.iteration), "") for run in runs}
    assert runs_in(b"\xff no table") == set()


def test_the_means_of_an_arm_are_over_runs_of_means_over_roll_outs():
    runs = [
        measured_run("one", "gwo", 0, start(0.0, 1.0, 20.0), start(0.5, 0.5)),
        measured_run("two", "gwo", 1, start(0.0, 1.0), start(0.5, 1.0)),
        measured_run("three", "fixed", 0, start(0.0, 0.0), start(0.5, 0.5)),
    ]
    table = arms_table(runs, 2)
    cells = {str(column.header).replace("\n", " "): list(column.cells) for column in table.columns}
    assert cells["motion, arm"] == ["walk\nfixed", "walk\ngwo"]
    assert cells["runs"] == ["1", "2"]
    # 1 and 2 of 2: mean 1.5, sample standard deviation sqrt(0.5); 75 and 100 %: 12.5 * sqrt(2).
    assert cells["succeed of 2"] == ["0.0", f"1.5\n± {math.sqrt(0.5):.1f}"]
    assert cells["sur- vival %"] == ["25.0", f"87.5\n± {12.5 * math.sqrt(2):.1f}"]
    assert cells["lag ms"] == ["-", "20.0"]
    with (console := Console(width=80)).capture() as shown:
        console.print(table)
    assert "…" not in shown.get()


def test_arms_are_methods_and_the_settings_in_which_their_runs_differ(untrained_run, tmp_path):
    config = yaml.safe_load((untrained_run / "config.yaml").read_text())

    def run(name, method, seed=0, scale=1.0, objective=None, **scale_settings):
        reward = {**config["reward"], "penalty_scale": scale}
        if objective:
            reward["objective"] = {"_target_": objective}
        changed = {"seed": seed, "reward": reward, "scale": {**config["scale"], **scale_settings}}
        return RunDirectory.create(tmp_path / name, {**config, **changed}, {"method": method})

    runs = [
        run("a", "fixed", seed=0, evaluate_starts=1),
        run("b", "fixed", seed=1, evaluate_starts=16),
        run("c", "gwo"),
        run("d", "gwo", scale=0.5),
    ]
    expected = ["fixed", "fixed", "gwo, penalty_scale=1.0", "gwo, penalty_scale=0.5"]
    assert arms_of(runs) == expected
    assert arms_of(runs[:3]) == ["fixed", "fixed", "gwo"]
    other = run("e", "gwo", objective="tlr_exp.reward.objectives.Other")
    assert "objective=Other" in arms_of([runs[2], other])[1]
    assert keys.REWARD_TERM_PREFIX == "reward_term/"
