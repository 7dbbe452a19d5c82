"""tlr-sync and the live mirror: exit statuses, kills, servers that come and go."""

import time
from pathlib import Path

import pytest
from stores import small_run, sql, steps

from tlr_exp.commands.sync import main
from tlr_exp.mlflow_sync.sources import found_below, store_of
from tlr_exp.mlflow_sync.tracking_uri import (
    check_tracking_uri,
    default_tracking_uri,
    sqlite_path,
)
from tlr_exp.records.credentials import hide_password
from tlr_exp.records.run_directory import RunDirectory

CLOSED_PORT = 9  # "discard": nothing listens there


@pytest.fixture(autouse=True)
def no_environment_uri(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("MLFLOW_TRACKING_URI", raising=False)


def make_run(path: Path, lines: int = 3) -> RunDirectory:
    return small_run(path, lines, experiment="from the tag")


# --- the command line ------------------------------------------------------------------------
def test_all_runs_below_a_folder_come_over_once(
    tmp_path: Path, database: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in ("a", "sweep/b"):
        make_run(tmp_path / "runs" / name).set_status("finished")
    uri = f"sqlite:///{database}"
    assert main([str(tmp_path / "runs"), "--tracking-uri", uri]) == 0
    printed = capsys.readouterr()
    assert "a: new run, 3 iterations (9 points), 2 files, FINISHED -> sqlite:///" in printed.out
    assert "b: new run" in printed.out
    assert printed.err == ""
    again = [str(tmp_path / "runs"), str(tmp_path / "runs" / "a"), "--tracking-uri", uri]
    assert main(again) == 0
    assert capsys.readouterr().out.count(": 0 iterations (0 points), 0 files, FINISHED") == 2
    assert steps(database) == [0, 0, 1, 1, 2, 2]
    assert sql(database, "SELECT name FROM experiments") == [("Default",), ("from the tag",)]


def test_server_that_is_down_is_status_one_and_says_what_to_do(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run = make_run(tmp_path / "a")
    start = time.monotonic()
    assert main([str(run.path), "--tracking-uri", f"http://127.0.0.1:{CLOSED_PORT}"]) == 1
    assert time.monotonic() - start < 10
    error = capsys.readouterr().err
    assert "a: MLflow at http://127.0.0.1:9: Connection refused" in error
    assert "still in the run directories. Later, repeat the command" in error


def test_damaged_run_does_not_keep_the_others_back(
    tmp_path: Path, database: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bad, good = make_run(tmp_path / "a"), make_run(tmp_path / "b")
    lines = bad.metrics_path.read_bytes().splitlines(keepends=True)
    bad.metrics_path.write_bytes(lines[0] + b"broken\n" + lines[2])
    uri = f"sqlite:///{database}"
    assert main([str(bad.path), str(good.path), "--tracking-uri", uri]) == 1
    assert f"the line at byte {len(lines[0])} is damaged" in capsys.readouterr().err
    assert steps(database) == [0, 1, 2]


def test_unreadable_folders_are_named_and_the_rest_comes_over(
    tmp_path: Path, database: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (make_run(tmp_path / "a").path / "manifest.json").write_text("{")
    make_run(tmp_path / "b").set_status("finished")
    (tmp_path / "sweeps" / "s").mkdir(parents=True)
    (tmp_path / "sweeps" / "s" / "sweep.json").write_text("[]")
    assert main([str(tmp_path), "--tracking-uri", f"sqlite:///{database}"]) == 1
    printed = capsys.readouterr()
    assert printed.out.startswith("b: new run")
    assert [line.partition(":")[0] for line in printed.err.splitlines()] == ["not copied"] * 2
    assert str(tmp_path / "a") in printed.err
    assert str(tmp_path / "sweeps" / "s") in printed.err
    assert steps(database) == [0, 1, 2]


def test_exported_tables_beside_the_runs_are_no_run(
    tmp_path: Path, database: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    make_run(tmp_path / "study" / "a").set_status("finished")
    tables = tmp_path / "study" / "results"
    tables.mkdir()
    (tables / "manifest.json").write_text('{"format": "tlr_exp study"}')
    (tables / "runs.parquet").write_bytes(b"")
    assert main([str(tmp_path / "study"), "--tracking-uri", f"sqlite:///{database}"]) == 0
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["{root}/nowhere"], "is not a directory. A run directory holds manifest.json"),
        (["{root}/empty"], "has no manifest.json"),
        (["{root}/a", "--tracking-uri", "mlruns"], "must be http://HOST:PORT, sqlite:///FILE"),
        (["{root}/a", "--tracking-uri", "sqlite://"], "name a file"),
        (["{root}", "--follow", "1"], "--follow is for one run or one sweep, not for 2"),
    ],
)
def test_wrong_arguments_are_status_two(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], arguments: list[str], message: str
) -> None:
    make_run(tmp_path / "a")
    make_run(tmp_path / "b")
    (tmp_path / "empty").mkdir()
    assert main([argument.format(root=tmp_path) for argument in arguments]) == 2
    assert message in capsys.readouterr().err


@pytest.mark.parametrize("arguments", [[], ["run", "--follow", "me"], ["run", "--no-such"]])
def test_unknown_options_are_status_two(arguments: list[str]) -> None:
    with pytest.raises(SystemExit) as caught:
        main(arguments)
    assert caught.value.code == 2


def test_store_is_the_one_given_or_of_the_environment_or_the_nearest(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run = make_run(tmp_path / "runs" / "study" / "a")
    runs = tmp_path / "runs"
    below, above = f"sqlite:///{runs}/study/mlflow.db", f"sqlite:///{runs}/mlflow.db"
    assert set(found_below([str(run.path)]).folders.values()) == {run.path.parent}
    assert set(found_below([str(runs), str(run.path)]).folders.values()) == {runs}
    (tmp_path / "mlflow.db").write_bytes(b"")  # too far above to be ours
    assert store_of(run, run.path.parent, None) == below
    assert store_of(run, runs, None) == above
    (runs / "mlflow.db").write_bytes(b"")
    assert store_of(run, run.path.parent, None) == above
    monkeypatch.setenv("MLFLOW_TRACKING_URI", "http://server:5000")
    assert store_of(run, runs, None) == "http://server:5000"
    assert store_of(run, runs, below) == below


# --- URIs ------------------------------------------------------------------------------------
def test_sqlite_uris_become_absolute(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert check_tracking_uri("sqlite:///runs/m.db") == f"sqlite:///{tmp_path}/runs/m.db"
    assert check_tracking_uri("sqlite:////a/m.db") == "sqlite:////a/m.db"
    assert default_tracking_uri("runs") == f"sqlite:///{tmp_path}/runs/mlflow.db"
    monkeypatch.setenv("MLFLOW_TRACKING_URI", "sqlite:///x.db")
    assert default_tracking_uri("runs") == f"sqlite:///{tmp_path}/x.db"


@pytest.mark.parametrize("uri", ["https://h", "postgresql+psycopg2://u:p@h/db", "http://h:5000/x"])
def test_servers_are_taken_as_they_are(uri: str) -> None:
    assert check_tracking_uri(uri) == uri
    assert sqlite_path(uri) is None


@pytest.mark.parametrize("uri", ["./mlruns", "file:///tmp/mlruns", "htp://h", "", "C:\\mlruns"])
def test_other_uris_are_refused(uri: str) -> None:
    with pytest.raises(ValueError, match=r"must be http://HOST:PORT, sqlite:///FILE"):
        check_tracking_uri(uri)


@pytest.mark.parametrize(
    ("uri", "shown"),
    [
        ("http://me:secret@host:5000/path", "http://host:5000/path"),
        ("http://host:5000", "http://host:5000"),
        ("sqlite:////a/b@c.db", "sqlite:////a/b@c.db"),
    ],
)
def test_passwords_are_hidden(uri: str, shown: str) -> None:
    assert hide_password(uri) == shown
