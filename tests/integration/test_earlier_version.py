"""A sweep and a stopped run of an earlier version: found, gone on with, measured and reported.

``tests/data/earlier_version`` says how they were made, and what that version made of them.
"""

import json
import shutil
from pathlib import Path

import pytest
from hydra import compose, initialize_config_module
from stores import children, latest, sql, statuses, steps

from analysis.commands import export, report
from analysis.data.tables import from_tables
from tests.integration.conftest import Trainer
from tlr_exp.commands import evaluate, sync
from tlr_exp.config.identity import run_identity
from tlr_exp.config.load import plain_config, with_absolute_paths
from tlr_exp.records.directory import FINISHED, INTERRUPTED
from tlr_exp.records.run_directory import RunDirectory
from tlr_exp.records.sweep_directory import SweepDirectory

DATA = Path(__file__).parents[1] / "data" / "earlier_version"
EXPECTED = DATA / "expected"
SWEEP = "multirun-0c258d49"
FIXED, GWO = "demo-fixed-seed0-7c56a1eb", "demo-gwo-seed0-63410476"
STOPPED = "demo-gwo-seed1-3b499507"  # by Ctrl-C in the first of its two iterations
ASKED_FOR = {
    FIXED: ("optimizer=fixed", "seed=0"),
    GWO: ("optimizer=gwo", "seed=0"),
    STOPPED: ("optimizer=gwo", "seed=1"),
}
# The words of the command of that time, and keys that came since with what all runs did then.
COMMAND = (
    *("scale.num_envs=10", "scale.iterations=2", "scale.checkpoint_every=2"),
    *("scale.evaluate_every=2", "scale.keep_checkpoints=1", "ppo.num_steps=4"),
    *("ppo.hidden_sizes=[8]", "num_threads=1", "physics.num_threads=1", "study=tiny"),
    *("tracking_uri=none", f"env.motion={DATA / 'short.npz'}", "recipe=paper"),
    *("precision=float32", "scale.evaluate_starts=1"),
)
# Other processors round otherwise, and a contact makes more of it within a second.
NEARLY = {"rel": 1e-3, "abs": 1e-5}


@pytest.fixture
def study(tmp_path: Path) -> Path:
    """A copy of the runs, as if they had been made in this folder."""
    return Path(shutil.copytree(DATA / "runs", tmp_path / "runs")) / "tiny"


def contents(folder: Path) -> dict[str, bytes]:
    """What was learned and measured: of every run its checkpoints and metrics."""
    files = [*folder.rglob("*.pt"), *folder.rglob("metrics.jsonl")]
    return {str(path): path.read_bytes() for path in files}


def expected(name: str) -> dict:
    return json.loads((EXPECTED / f"{name}.json").read_text())


def assert_nearly(now: object, then: object) -> None:
    """All that was known then, whatever has come to be known besides."""
    if isinstance(then, dict):
        assert isinstance(now, dict)
        for key in then.keys() - {"run", "motion"}:
            assert_nearly(now[key], then[key])
    elif isinstance(then, list):
        assert isinstance(now, list)
        for one, other in zip(now, then, strict=True):
            assert_nearly(one, other)
    else:
        assert now == (pytest.approx(then, **NEARLY) if isinstance(then, float) else then)


# --- which runs they are ---------------------------------------------------------------------


@pytest.mark.parametrize("name", ASKED_FOR)
def test_the_same_words_mean_the_same_run(name):
    with initialize_config_module("tlr_exp.conf", version_base="1.3"):
        config = compose("config", [*COMMAND, *ASKED_FOR[name]])
    run = RunDirectory.open(DATA / "runs" / "tiny" / name)
    identity = run.manifest["identity"]
    assert name.endswith(identity)
    assert run_identity(with_absolute_paths(plain_config(config))) == identity
    assert run_identity(run.config, run.manifest["files"]) == identity


def test_a_stopped_run_is_gone_on_with(study):
    assert RunDirectory.open(study / STOPPED).status == INTERRUPTED
    status, output = Trainer.call(study.parents[1], *COMMAND, *ASKED_FOR[STOPPED], "resume=auto")
    assert status == 0, output
    assert {path.parent.name for path in study.glob("*/manifest.json")} == set(ASKED_FOR)
    run = RunDirectory.open(study / STOPPED)
    assert run.status == FINISHED
    first, second = run.metrics()
    assert first == RunDirectory.open(DATA / "runs" / "tiny" / STOPPED).metrics()[0]
    then = {key: value for key, value in expected("second_iteration").items() if value is not None}
    learned = {key for key in then if not key.startswith("time/") and key != "wall_time"}
    assert_nearly(second, {key: then[key] for key in learned})


def test_a_finished_run_is_not_trained_again(study):
    before = contents(study)
    status, output = Trainer.call(study.parents[1], *COMMAND, *ASKED_FOR[GWO], "resume=auto")
    assert (status, "trained already" in output) == (0, True), output
    assert contents(study) == before


def test_the_command_of_the_sweep_finds_all_jobs_trained(study):
    before = contents(study)
    status, output = Trainer.call(study.parents[1], "-m", *COMMAND, "optimizer=fixed,gwo", "seed=0")
    assert (status, "all 2 jobs are trained" in output) == (0, True), output
    assert contents(study) == before
    assert [path.name for path in (study / "sweeps").iterdir() if path.is_dir()] == [SWEEP]
    jobs = SweepDirectory(study / "sweeps" / SWEEP).jobs()
    assert [(job.run, job.status) for job in jobs] == [(FIXED, FINISHED), (GWO, FINISHED)]


# --- what is made of them --------------------------------------------------------------------


def evaluated(run: Path, output: Path, *arguments: str) -> dict:
    bare = ["--no-video", "--no-pictures", "-o", str(output)]
    assert evaluate.main([str(run), *bare, *arguments]) == 0
    (path,) = output.glob("*.json")
    return json.loads(path.read_text())


@pytest.mark.parametrize("name", [FIXED, GWO])
def test_an_evaluation_gives_the_numbers_of_that_version(study, name, tmp_path):
    assert_nearly(evaluated(study / name, tmp_path / "one"), expected(name))
    three = evaluated(study / name, tmp_path / "three", "--starts", "3")
    assert_nearly(three, expected(f"{name}-3starts"))


def test_tables_and_report_hold_what_was_measured(study, tmp_path):
    output, page = tmp_path / "exported", tmp_path / "report"
    assert export.main([str(study / "sweeps" / SWEEP), "-o", str(output)]) == 0
    exported = from_tables(output)
    assert exported.arms == ("fixed", "gwo")
    for name, curve in exported.curves.groupby("run"):
        rows = curve.set_index("iteration").to_dict("index")
        assert_measured(RunDirectory.open(study / str(name)).metrics(), rows)

    assert report.main([str(output), "-o", str(page)]) == 0
    text = (page / "report.md").read_text()
    assert "Machinery, not evidence." in text
    last = exported.curves[exported.curves["iteration"] == 2].set_index("run")
    assert f"{last.loc[GWO, 'eval/upper_body_error_m']:.4f}" in text


def assert_measured(lines: list[dict], rows: dict) -> None:
    """Every number of the lines is in the rows, by iteration, to the last digit."""
    for line in lines:
        measured = {key: value for key, value in line.items() if value == value}
        iteration, _ = measured.pop("iteration"), measured.pop("wall_time")
        assert len(measured) > 30
        assert {key: rows[iteration][key] for key in measured} == measured


def test_everything_reaches_mlflow_once(study, database):
    uri = ["--tracking-uri", f"sqlite:///{database}"]
    assert sync.main([str(study / "sweeps" / SWEEP), *uri]) == 0
    (parent,) = set(statuses(database)) - {FIXED, GWO}
    assert statuses(database) == {parent: "FINISHED", FIXED: "FINISHED", GWO: "FINISHED"}
    assert children(database, parent) == {FIXED, GWO}
    assert steps(database, "train/episode_length") == [1, 1, 2, 2]
    for name in (FIXED, GWO):
        last = RunDirectory.open(study / name).metrics()[-1]
        assert_measured([last], {2: latest(database, name)})
    before = sql(database, "SELECT * FROM metrics ORDER BY 1, 2, 3")
    assert sync.main([str(study / "sweeps" / SWEEP), *uri]) == 0
    assert sql(database, "SELECT * FROM metrics ORDER BY 1, 2, 3") == before
