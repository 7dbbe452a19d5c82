"""tlr-export: from runs to tables by one command, or one message and nothing."""

import json
import shutil
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from studies import load_study, make_study, write_run_directories

from analysis.commands.export import main
from analysis.data.run_directories import from_run_directories
from analysis.data.study import StudyError
from analysis.data.tables import from_tables
from tlr_exp.mlflow_sync.upload_run import RunUpload
from tlr_exp.records.run_directory import RunDirectory
from tlr_exp.records.sweep_directory import SweepDirectory


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Six run directories: fixed and gwo, seeds 0 to 2."""
    root = tmp_path_factory.mktemp("made") / "five-seeds"
    write_run_directories(make_study(np.random.default_rng(0), seeds=range(3), iterations=4), root)
    return root


@pytest.fixture
def runs(made: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(made, tmp_path / "home" / "ann" / "five-seeds"))


def run_of(runs: Path, start: str) -> Path:
    (found,) = runs.glob(f"{start}*")
    return found


def set_manifest(run: Path, **changes: object) -> None:
    manifest = json.loads((run / "manifest.json").read_text())
    (run / "manifest.json").write_text(json.dumps({**manifest, **changes}))


def set_config(run: Path, old: str, new: str) -> None:
    text = (run / "config.yaml").read_text()
    assert old in text
    (run / "config.yaml").write_text(text.replace(old, new))


def test_runs_become_tables(runs: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "out"
    assert main([str(runs), "-o", str(out)]) == 0
    study = from_tables(out)
    assert [study.seeds(arm) for arm in ("fixed", "gwo")] == [(0, 1, 2), (0, 1, 2)]
    first, fixed, gwo = capsys.readouterr().out.splitlines()[:3]
    assert first.startswith(f"{out}: 6 runs, 4 iterations, 39 metrics, ")
    assert (fixed, gwo) == ("  fixed: seeds 0, 1, 2", "  gwo: seeds 0, 1, 2")
    disk = {run.name: run.curve for run in from_run_directories(runs)}
    for name, curve in study.curves.groupby("run"):
        kept = curve.drop(columns=["run", "arm", "seed"]).reset_index(drop=True)
        pd.testing.assert_frame_equal(kept[disk[str(name)].columns], disk[str(name)])


def test_neither_people_nor_machines_are_in_the_tables(runs: Path, tmp_path: Path) -> None:
    for path in runs.iterdir():
        machine = {"host": "ann-laptop", "cpu_model": "A Processor"}
        command = f"train.py runs_dir={tmp_path}/home/ann/five-seeds"
        set_manifest(path, machine=machine, command=command)
        set_config(path, "runs_dir: runs", f"runs_dir: {tmp_path}/home/ann/five-seeds")
        set_config(path, "motion: gym_motion", f"motion: {tmp_path}/home/ann/walk.npz")
    out = tmp_path / "out"
    assert main([str(runs), "-o", str(out)]) == 0
    study = from_tables(out)
    config = json.loads(study.runs["config"].iloc[0])
    assert (config["runs_dir"], config["env"]["motion"]) == ("five-seeds", "walk.npz")
    assert set(study.runs["command"]) == {"train.py runs_dir=five-seeds"}
    assert set(study.runs["host"]) == {"machine 1"}
    manifest = json.loads((out / "manifest.json").read_text())
    assert manifest["source"] == ["five-seeds"]
    assert manifest["command"] == "tlr-export five-seeds -o out"
    everything = study.runs.to_csv() + json.dumps(manifest)
    assert "ann" not in everything


def test_refusals_are_named_and_nothing_is_written(
    runs: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    set_manifest(run_of(runs, "demo-gwo-seed1"), status="running")
    set_config(run_of(runs, "demo-gwo-seed2"), "gamma: 0.99", "gamma: 0.9")
    shutil.rmtree(run_of(runs, "demo-fixed-seed0"))
    assert main([str(runs), "-o", str(tmp_path / "out")]) == 1
    lines = capsys.readouterr().err.splitlines()
    assert "demo-gwo-seed1" in lines[0]
    assert "still running, or was killed, after 4 of 4 iterations" in lines[0]
    assert lines[1] == "arm 'fixed' lacks seed 0, which 'gwo' has"
    assert "ppo.gamma is 0.9, but 0.99 in" in lines[2]
    assert [line.split()[0] for line in lines[3:]] == ["(--allow-unfinished", "(--seeds", "(--arms"]
    assert not (tmp_path / "out").exists()
    options = ["--allow-unfinished", "--seeds", "common", "--ignore", "ppo.gamma"]
    assert main([str(runs), "-o", str(tmp_path / "out"), *options]) == 0
    assert from_tables(tmp_path / "out").seeds("gwo") == (1, 2)
    notes = [line for line in capsys.readouterr().out.splitlines() if line.startswith("  note: ")]
    assert len(notes) == len(from_tables(tmp_path / "out").notes) >= 3


def test_a_folder_with_something_in_it(
    runs: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    out.mkdir()
    (out / "notes.txt").write_text("ours")
    assert main([str(runs), "-o", str(out)]) == 1
    assert "is not empty" in capsys.readouterr().err
    assert [path.name for path in out.iterdir()] == ["notes.txt"]
    assert main([str(runs), "-o", str(out), "--force"]) == 0
    assert (out / "notes.txt").read_text() == "ours"
    assert len(from_tables(out).runs) == 6


@pytest.mark.parametrize(
    "arguments",
    [
        ["-o", "out"],
        ["runs", "--experiment", "x", "-o", "out"],
        ["runs", "--tracking-uri", "http://127.0.0.1:1", "-o", "out"],
        ["runs", "--sweep", "a-1", "-o", "out"],
        ["runs"],
        ["runs", "-o", "out", "--seeds", "some"],
    ],
)
def test_wrong_arguments(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as caught:
        main(arguments)
    assert caught.value.code == 2
    assert "tlr-export: error:" in capsys.readouterr().err


def test_runs_in_several_places(runs: Path, tmp_path: Path) -> None:
    other = tmp_path / "other"
    other.mkdir()
    for path in runs.glob("demo-gwo-*"):
        shutil.move(str(path), other)
    assert main([str(runs), str(other), "-o", str(tmp_path / "out")]) == 0
    assert len(from_tables(tmp_path / "out").runs) == 6


def test_arms_by_a_key(runs: Path, tmp_path: Path) -> None:
    for path in runs.glob("demo-fixed-*"):
        shutil.rmtree(path)
    for number in range(3):
        path = run_of(runs, f"demo-gwo-seed{number}")
        copy = Path(shutil.copytree(path, runs / f"copy{number}"))
        set_manifest(copy, name=f"copy{number}", run_id=f"copy{number}")
        set_config(copy, "threshold_share: 0.1", "threshold_share: 0.02")
    out = tmp_path / "out"
    assert main([str(runs), "-o", str(out)]) == 1
    arms = ["--arms", "optimizer,reward.objective.threshold_share"]
    assert main([str(runs), "-o", str(out), *arms, "--baseline", "gwo, threshold_share=0.1"]) == 0
    assert from_tables(out).arms == ("gwo, threshold_share=0.1", "gwo, threshold_share=0.02")
    # An exported study has its arms, and can be exported again without naming them.
    assert main([str(out), "-o", str(tmp_path / "again")]) == 0
    assert from_tables(tmp_path / "again").arms == from_tables(out).arms


def test_the_arms_of_a_sweep_are_those_it_was_made_for(runs: Path) -> None:
    """Three runs of one optimizer with shares of their own: one arm each, as the sweep says."""
    sweep = SweepDirectory.prepare(runs, "threshold", "0011aabb")
    sweep.begin("tlr-train -m", num_jobs=3)
    for number, share in enumerate(("0.02", "0.1", "0.5")):
        path = run_of(runs, f"demo-gwo-seed{number}")
        set_config(path, "threshold_share: 0.1", f"threshold_share: {share}")
        set_config(path, f"seed: {number}", "seed: 0")
        set_manifest(path, seed=0)
        run_id = json.loads((path / "manifest.json").read_text())["run_id"]
        sweep.write_job(number, "finished", overrides=[], run=path.name, run_id=run_id)
    with pytest.raises(StudyError, match="threshold_share"):
        load_study([sweep.path])
    # A group is written as on the command line there.
    sweep.set_status("finished", arms=["reward/objective.threshold_share"])
    arms = load_study([sweep.path]).arms
    assert arms == ("threshold_share=0.02", "threshold_share=0.1", "threshold_share=0.5")


def test_exported_studies_are_sources_and_keep_their_notes(runs: Path, tmp_path: Path) -> None:
    shutil.rmtree(run_of(runs, "demo-gwo-seed1"))
    parts = [tmp_path / "a", tmp_path / "b"]
    assert main([str(runs), "-o", str(parts[0]), "--seeds", "common"]) == 0
    (left_out,) = [note for note in from_tables(parts[0]).notes if "left out" in note]
    rest = load_study([parts[0]])
    assert left_out in rest.notes
    again = load_study([parts[0]], arm_keys=["optimizer"])
    assert left_out in again.notes
    pd.testing.assert_frame_equal(again.runs, rest.runs)
    pd.testing.assert_frame_equal(again.curves, rest.curves)
    single = run_of(runs, "demo-fixed-seed1")
    with pytest.raises(StudyError, match="arm 'gwo' lacks seed 1, which 'fixed' has"):
        load_study([parts[0], single])


def test_an_mlflow_experiment(
    runs: Path,
    made_store: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    (tmp_path / "runs").mkdir()
    uri = f"sqlite:///{shutil.copy(made_store, tmp_path / 'runs' / 'mlflow.db')}"
    for seed in (0, 1):
        for arm in ("fixed", "gwo"):
            RunUpload(RunDirectory(run_of(runs, f"demo-{arm}-seed{seed}")), uri, "my study").push()
    arguments = ["--experiment", "my study", "-o"]
    assert main([*arguments, str(tmp_path / "a"), "--tracking-uri", uri]) == 0
    assert from_tables(tmp_path / "a").seeds("gwo") == (0, 1)
    manifest = json.loads((tmp_path / "a" / "manifest.json").read_text())
    assert manifest["source"] == ["MLflow experiment my study"]
    monkeypatch.delenv("MLFLOW_TRACKING_URI", raising=False)
    monkeypatch.chdir(tmp_path)  # where runs/mlflow.db is
    assert main([*arguments, str(tmp_path / "b")]) == 0
    monkeypatch.setenv("MLFLOW_TRACKING_URI", f"sqlite:///{tmp_path / 'none.db'}")
    capsys.readouterr()
    assert main([*arguments, str(tmp_path / "c")]) == 1
    assert capsys.readouterr().err == f"tlr-export: there is no MLflow store {tmp_path}/none.db\n"
