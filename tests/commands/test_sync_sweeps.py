"""tlr-sync on sweeps: from the command line, live, through kills, and over HTTP."""

import os
import signal
import subprocess
import sys
import textwrap
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from stores import (
    artifacts,
    children,
    free_port,
    latest,
    server,
    sql,
    statuses,
    steps,
    tag,
    wait_until,
)

from tlr_exp.commands.sync import main
from tlr_exp.mlflow_sync.mirror import Mirror
from tlr_exp.mlflow_sync.sources import find_sources
from tlr_exp.records.run_directory import RunDirectory
from tlr_exp.records.sweep_directory import SweepDirectory

ID = "0011aabb"
PARENT = f"two-demo-{ID}"


@pytest.fixture(autouse=True)
def no_environment(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("MLFLOW_TRACKING_URI", "TLR_SYNC_MAX_FILE_MB"):
        monkeypatch.delenv(name, raising=False)


@pytest.fixture
def study(tmp_path: Path) -> Path:
    return tmp_path / "runs" / "tlr"


def add_run(study: Path, name: str, lines: int = 3, status: str = "finished") -> RunDirectory:
    tags = {"method": "gwo", "scale": "demo", "experiment": "tlr"}
    run = RunDirectory.create(study / name, {"seed": 0}, tags)
    for iteration in range(1, lines + 1):
        run.log(iteration, {"train/loss": iteration / 3, "train/episode_length": 10.0})
    run.set_status(status)
    return run


def add_sweep(study: Path, sweep_id: str, *runs: RunDirectory) -> SweepDirectory:
    sweep = SweepDirectory.prepare(study, "two", sweep_id)
    sweep.begin("tlr-train -m seed=0,1", len(runs), tags={"scale": "demo"})
    for num, run in enumerate(runs):
        run_id = run.manifest["run_id"]
        sweep.write_job(num, "finished", overrides=[], run=run.path.name, run_id=run_id)
    return sweep


# --- the command line ------------------------------------------------------------------------
def test_study_comes_over_with_its_sweeps_and_loose_runs(
    study: Path, database: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    sweep = add_sweep(study, ID, add_run(study, "run0"), add_run(study, "run1"))
    sweep.set_status("finished")
    add_run(study, "loose")
    exported = sweep.path / "report" / "tables"
    exported.mkdir(parents=True)
    (exported / "manifest.json").write_text("{}")  # of an exported table, not of a run
    uri = ["--tracking-uri", f"sqlite:///{database}"]
    assert main([str(study), *uri]) == 0
    out, err = capsys.readouterr()
    assert err == ""
    lines = out.splitlines()
    assert lines[0].startswith(f"{PARENT}: new sweep, 2 runs, 2 files, FINISHED -> sqlite:///")
    assert lines[1].startswith("  run0: new run, 3 iterations (")
    assert lines[2].startswith("  run1: new run")
    assert lines[3].startswith("loose: new run")
    assert len(lines) == 4
    assert children(database, PARENT) == {"run0", "run1"}
    assert len(statuses(database)) == 4
    before = sql(database, "SELECT * FROM metrics")
    assert main([str(sweep.path), str(study), str(study / "run0"), *uri]) == 0
    assert "new" not in capsys.readouterr().out
    assert sql(database, "SELECT * FROM metrics") == before
    assert len(statuses(database)) == 4


def test_problem_with_one_run_is_status_one(
    study: Path, database: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bad = add_run(study, "bad")
    sweep = add_sweep(study, ID, bad, add_run(study, "good"))
    text = bad.metrics_path.read_text().splitlines()
    bad.metrics_path.write_text("\n".join([text[0], "broken", text[2], ""]))
    assert main([str(sweep.path), "--tracking-uri", f"sqlite:///{database}"]) == 1
    assert "bad: " in capsys.readouterr().err
    assert children(database, PARENT) == {"bad", "good"}


def test_store_and_limit_of_a_sweep(study: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    sweep = add_sweep(study, ID)
    (source,), _ = find_sources([str(sweep.path)])
    assert source.uri == f"sqlite:///{study.parent}/mlflow.db"
    assert (source.experiment, source.max_file_mb) == ("tlr", 64.0)
    (study / "mlflow.db").write_bytes(b"")
    monkeypatch.setenv("TLR_SYNC_MAX_FILE_MB", "1.5")
    (source,), _ = find_sources([str(study)], experiment="mine")
    assert source.uri == f"sqlite:///{study}/mlflow.db"
    assert (source.experiment, source.max_file_mb) == ("mine", 1.5)


def test_wrong_limit_and_two_to_follow_are_status_two(
    study: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    add_sweep(study, ID)
    add_sweep(study, "ffffffff")
    assert main([str(study), "--follow", "1"]) == 2
    assert "for one run or one sweep, not for 2" in capsys.readouterr().err
    monkeypatch.setenv("TLR_SYNC_MAX_FILE_MB", "-3")
    assert main([str(study)]) == 2
    assert "TLR_SYNC_MAX_FILE_MB: -3: must be 0 or more" in capsys.readouterr().err
    with pytest.raises(SystemExit):
        main([str(study), "--max-file-mb", "many"])


# --- live ------------------------------------------------------------------------------------
SWEEP = """
    import sys, time
    from tlr_exp.mlflow_sync.mirror import Mirror
    from tlr_exp.records.run_directory import RunDirectory
    from tlr_exp.records.sweep_directory import SweepDirectory
    study, uri, end, first, last = sys.argv[1:]
    sweep = SweepDirectory.prepare(study, "two", "0011aabb")
    with sweep.lock():
        sweep.begin("tlr-train -m seed=0,1", 2, tags={"scale": "demo"})
        mirror = Mirror.start(sweep, uri, "tlr")
        for num in range(int(first), int(last) + 1):
            tags = {"method": "gwo", "scale": "demo", "experiment": "tlr"}
            run = RunDirectory.create(f"{study}/run{num}", {"seed": num}, tags)
            job = {"run": run.path.name, "run_id": run.manifest["run_id"]}
            with run.lock():
                sweep.write_job(num, "running", overrides=[f"seed={num}"], **job)
                for iteration in range(1, 11):
                    run.log(iteration, {"train/loss": iteration / 3})
                if end == "kill" and num == int(last):
                    print(mirror._process.pid, flush=True)
                    time.sleep(100)
                run.set_status("finished")
            sweep.write_job(num, "finished")
        sweep.set_status(end)
        print(mirror.finish(90), flush=True)
"""


@contextmanager
def sweeping(*arguments: object) -> Iterator[subprocess.Popen[str]]:
    command = [sys.executable, "-c", textwrap.dedent(SWEEP), *map(str, arguments)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        yield process


def test_killed_sweep_is_marked_and_when_continued_ends_properly(
    study: Path, database: Path
) -> None:
    uri = f"sqlite:///{database}"
    with sweeping(study, uri, "kill", 0, 1) as process:
        assert process.stdout is not None
        process.stdout.readline()
        running = {PARENT: "RUNNING", "run0": "FINISHED", "run1": "RUNNING"}
        wait_until(lambda: statuses(database) == running)
        process.send_signal(signal.SIGKILL)
    killed = {PARENT: "KILLED", "run0": "FINISHED", "run1": "KILLED"}
    wait_until(lambda: statuses(database) == killed)
    assert steps(database) == sorted([*range(1, 11)] * 2)
    with sweeping(study, uri, "finished", 2, 2) as process:
        assert process.communicate()[0] == "True\n"
    assert statuses(database) == {
        PARENT: "FINISHED", "run0": "FINISHED", "run1": "KILLED", "run2": "FINISHED",
    }  # fmt: skip
    assert children(database, PARENT) == {"run0", "run1", "run2"}
    assert (study / "sweeps" / f"two-{ID}" / "sync.log").is_file()


def test_job_that_outlives_its_sweep_is_mirrored_to_its_end(study: Path, database: Path) -> None:
    job = add_run(study, "run0", status="running")
    sweep = add_sweep(study, ID, job)
    sweep.write_job(0, "running")
    with job.lock():
        with subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE) as owner:
            command = [sys.executable, "-m", "tlr_exp.commands.sync", str(sweep.path)]
            uri = ["--tracking-uri", f"sqlite:///{database}"]
            follower = subprocess.Popen([*command, "--follow", str(owner.pid), *uri])
            wait_until(lambda: "run0" in statuses(database))
            owner.send_signal(signal.SIGKILL)
        # Nobody holds the sweep's lock: it is over at once, its job is not.
        wait_until(lambda: statuses(database) == {PARENT: "KILLED", "run0": "RUNNING"})
        job.log(4, {"train/loss": 1.0})
        wait_until(lambda: steps(database) == [1, 2, 3, 4])
        assert follower.poll() is None
        job.set_status("finished")
        sweep.write_job(0, "finished")
    assert follower.wait(60) == 0
    assert statuses(database) == {PARENT: "KILLED", "run0": "FINISHED"}
    assert latest(database, PARENT)["jobs/finished"] == 1


def test_start_of_a_sweep_mends_another_that_was_killed_with_its_mirror(
    study: Path, database: Path
) -> None:
    uri = f"sqlite:///{database}"
    dead, alive = add_sweep(study, "ffffffff"), add_sweep(study, ID)
    add_sweep(study, "eeeeeeee")  # killed, too, but this store never had it
    with dead.lock():
        assert main([str(dead.path), "--tracking-uri", uri]) == 0
    assert statuses(database) == {"two-demo-ffffffff": "RUNNING"}
    with alive.lock():
        live = Mirror.start(alive, uri, "tlr")
        wait_until(lambda: statuses(database).get("two-demo-ffffffff") == "KILLED")
        alive.set_status("finished")
        assert live.finish(60)
    assert statuses(database) == {"two-demo-ffffffff": "KILLED", PARENT: "FINISHED"}


def test_deleted_sweep_ends_its_mirror(study: Path, database: Path) -> None:
    sweep = add_sweep(study, ID)
    live = Mirror.start(sweep, f"sqlite:///{database}", "tlr")
    (sweep.path / "sweep.json").unlink()
    assert not live.finish(60)


# --- a tracking server -----------------------------------------------------------------------
@pytest.mark.slow
def test_server_over_http_gets_parent_and_children(
    study: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    port = free_port()
    monkeypatch.setenv("MLFLOW_TRACKING_URI", f"http://127.0.0.1:{port}")
    (tmp_path / "server").mkdir()
    database = tmp_path / "server" / "mlflow.db"
    run = add_run(study, "run0")
    (run.path / "checkpoints").mkdir()
    (run.path / "checkpoints" / "000003.pt").write_bytes(bytes(100_000))
    sweep = add_sweep(study, ID, run, add_run(study, "run1"))
    (sweep.path / "figures").mkdir()
    (sweep.path / "figures" / "6.svg").write_text("<svg/>")
    with server(tmp_path / "server", port) as uri:
        with sweep.lock():
            live = Mirror.start(sweep, uri, "tlr")
            wait_until(lambda: children(database, PARENT) == {"run0", "run1"})
            assert statuses(database)[PARENT] == "RUNNING"
            sweep.set_status("finished")
            assert live.finish(60)
        before = sql(database, "SELECT * FROM metrics")
        assert main([str(study)]) == 0
    assert statuses(database) == {PARENT: "FINISHED", "run0": "FINISHED", "run1": "FINISHED"}
    assert sql(database, "SELECT * FROM metrics") == before
    assert latest(database, "run0")["final/episode_length"] == 10.0
    assert "tlr-train -m seed=0,1" in (tag(database, PARENT, "mlflow.note.content") or "")
    ids = dict(sql(database, "SELECT name, run_uuid FROM runs"))
    there = tmp_path / "server" / "artifacts"
    assert artifacts(there, ids[PARENT]) == {"sweep.json", "figures/6.svg"}
    assert artifacts(there, ids["run0"]) == {
        "config.yaml", "manifest.json", "checkpoints/000003.pt",
    }  # fmt: skip
    assert not (Path(os.getcwd()) / "mlruns").exists()
