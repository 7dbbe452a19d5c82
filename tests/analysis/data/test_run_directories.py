"""Run directories are read as far as they have come; damage is named."""

import json
import math
import shutil
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from studies import make_study, write_run_directories

from analysis.data.run_directories import from_run_directories
from analysis.data.study import StudyError
from tlr_exp.records.run_directory import RunDirectory
from tlr_exp.records.sweep_directory import SweepDirectory


@pytest.fixture
def runs(tmp_path: Path) -> Path:
    """Four runs of five iterations."""
    study = make_study(np.random.default_rng(0), seeds=range(2), iterations=5)
    write_run_directories(study, tmp_path / "runs")
    return tmp_path / "runs"


def error_of(*arguments: object) -> str:
    with pytest.raises(StudyError) as caught:
        from_run_directories(*arguments)  # type: ignore[arg-type]
    return str(caught.value)


def first(runs: Path) -> Path:
    return sorted(path for path in runs.iterdir())[0]


def test_runs_are_found_below_a_folder_and_each_once(runs: Path) -> None:
    deep = runs.parent / "deep" / "study"
    deep.parent.mkdir()
    shutil.move(str(runs), deep)
    copies = deep / "mlartifacts" / "1"
    shutil.copytree(first(deep), copies)
    found = from_run_directories([deep.parent, first(deep), deep])
    assert [run.name for run in found] == sorted(path.name for path in deep.glob("demo-*"))


def test_a_line_torn_by_a_kill_and_an_iteration_written_twice(runs: Path) -> None:
    path = first(runs)
    whole = from_run_directories(path)[0].curve
    metrics = path / "metrics.jsonl"
    again = json.loads(metrics.read_text().splitlines()[2]) | {"ppo/kl": 0.75, "ppo/entropy": None}
    with open(metrics, "a") as file:
        file.write(f"{json.dumps(again)}\n" + '{"iteration": 6, "ppo/')
    curve = from_run_directories(path)[0].curve
    assert curve["iteration"].tolist() == [1, 2, 3, 4, 5]
    assert curve.loc[2, "ppo/kl"] == 0.75
    assert math.isnan(curve.loc[2, "ppo/entropy"])
    pd.testing.assert_frame_equal(curve.drop(index=2), whole.drop(index=2))
    with open(metrics, "a") as file:
        file.write("\n")  # whole as a line, and still no metrics: the last one may be
    assert len(from_run_directories(path)[0].curve) == 5
    with open(metrics, "a") as file:
        file.write(f"{json.dumps(again)}\n")
    assert error_of(path).startswith(f"{metrics}: the line at byte ")


def test_a_run_that_has_just_begun_has_an_empty_curve(runs: Path) -> None:
    (first(runs) / "metrics.jsonl").unlink()
    (run,) = from_run_directories(first(runs))
    assert len(run.curve) == 0
    assert run.control_steps == 0


def test_damaged_runs_are_named_all_at_once(runs: Path) -> None:
    one, two, three, four = sorted(runs.iterdir())
    (one / "config.yaml").unlink()
    (two / "config.yaml").write_text("scale: [1, {")
    manifest = json.loads((three / "manifest.json").read_text())
    del manifest["tags"]["method"]
    (three / "manifest.json").write_text(json.dumps({**manifest, "seed": None}))
    config = (four / "config.yaml").read_text().replace("num_steps: 24", "num_steps: many")
    (four / "config.yaml").write_text(config)
    lines = error_of(runs).splitlines()
    assert lines[0].startswith(f"cannot read {one / 'config.yaml'}: ")
    assert lines[1].startswith(f"cannot read {two / 'config.yaml'}: ")
    assert lines[2] == f"{three}: manifest.json: seed is None; it must be an integer"
    assert lines[3] == f"{three}: manifest.json has no tags.method, the name of the optimizer"
    assert lines[4] == f"{four}: config.yaml: ppo.num_steps is 'many'; it must be an integer"
    assert len(lines) == 5


def test_a_metric_that_is_no_number(runs: Path) -> None:
    metrics = first(runs) / "metrics.jsonl"
    metrics.write_text(metrics.read_text() + '{"iteration": 6, "ppo/kl": "low"}\n')
    message = error_of(first(runs))
    assert message == f"{metrics}: ppo/kl is 'low' in iteration 6; it must be a number"


def test_folders_without_runs(tmp_path: Path) -> None:
    paths = [tmp_path, tmp_path / "none"]
    assert error_of(paths).splitlines() == [
        f"{tmp_path}: holds no run directory",
        f"{tmp_path / 'none'}: there is no such folder",
    ]


def test_the_runs_of_a_sweeps_jobs(runs: Path) -> None:
    names = [path.name for path in sorted(runs.iterdir())]
    sweep = SweepDirectory.prepare(runs, "five_seeds", "0011aabb")
    sweep.begin("tlr-train -m", num_jobs=3)
    for num, name in enumerate(names[1:3]):
        run = RunDirectory.open(runs / name)
        overrides = [f"seed={num}"]
        sweep.write_job(
            num, "finished", overrides=overrides, run=name, run_id=run.manifest["run_id"]
        )
    sweep.write_job(2, "failed", overrides=["seed=2", "x=1"], error="out of memory")
    message = error_of(sweep.path)
    assert message == "five_seeds-0011aabb: job 2 (seed=2 x=1) has no run: out of memory"
    found = from_run_directories(sweep.path, allow_unfinished=True)
    assert [run.name for run in found] == names[1:3]
    # A study with its sweeps has each of its runs once.
    assert [run.name for run in from_run_directories(runs)] == names
