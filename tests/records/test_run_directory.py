"""The run directory: what is written is whole, survives kills and full disks, and reads back."""

import errno
import json
import math
import os
import signal
import subprocess
import sys
import textwrap
import time
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tlr_exp.records import storage
from tlr_exp.records.metrics_file import DamagedMetricsError, read_metrics
from tlr_exp.records.provenance import git_state, machine, package_versions
from tlr_exp.records.run_directory import RunDirectory, RunDirectoryError
from tlr_exp.records.storage import StorageError, append_line, atomic_write

CONFIG = {"seed": 3, "ppo": {"gamma": 0.99, "rate": 1e-5, "hidden": [512, 256]}, "note": None}


@pytest.fixture
def run(tmp_path: Path) -> RunDirectory:
    return RunDirectory.create(tmp_path / "runs" / "gwo", CONFIG, {"method": "gwo"}, "0011aabb")


def start_python(code: str, *arguments: str) -> subprocess.Popen[str]:
    command = [sys.executable, "-c", textwrap.dedent(code), *arguments]
    return subprocess.Popen(command, stdout=subprocess.PIPE, text=True)


def kill(process: subprocess.Popen[str]) -> None:
    process.send_signal(signal.SIGKILL)
    process.communicate()


def full_disk_at(path: Path) -> None:
    """Every write to `path` fails with the system's own ENOSPC."""
    path.symlink_to("/dev/full")


# --- create and open -------------------------------------------------------------------------
def test_create_writes_configuration_and_manifest(run: RunDirectory) -> None:
    manifest = RunDirectory.open(run.path).manifest
    assert run.config == CONFIG
    assert manifest["name"] == "gwo"
    assert manifest["identity"] == "0011aabb"
    assert manifest["seed"] == 3
    assert manifest["status"] == "running"
    assert manifest["pid"] == os.getpid()
    assert manifest["packages"]["torch"]
    assert manifest["machine"]["cpu_count"] == os.cpu_count()
    assert manifest["created_at"] <= manifest["updated_at"]
    assert not list(run.path.glob(".*"))


def test_every_run_has_its_own_id(tmp_path: Path) -> None:
    ids = {RunDirectory.create(tmp_path / n, {}, {}).manifest["run_id"] for n in "abc"}
    assert len(ids) == 3


def test_create_takes_an_empty_folder_and_refuses_a_full_one(tmp_path: Path) -> None:
    (tmp_path / "empty").mkdir()
    RunDirectory.create(tmp_path / "empty", CONFIG, {})
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "thesis.txt").write_text("mine")
    with pytest.raises(RunDirectoryError, match=r"full is not empty.*choose another name"):
        RunDirectory.create(tmp_path / "full", CONFIG, {})
    assert [path.name for path in (tmp_path / "full").iterdir()] == ["thesis.txt"]


def test_create_below_a_file_says_which_folder(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(StorageError, match=r"cannot make the run directory .*file/run: Not a dir"):
        RunDirectory.create(tmp_path / "file" / "run", CONFIG, {})


def test_create_in_a_read_only_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(self: Path, *_: object, **__: object) -> None:
        raise OSError(errno.EROFS, os.strerror(errno.EROFS), str(self))

    monkeypatch.setattr(Path, "mkdir", refuse)
    with pytest.raises(StorageError, match=r"Read-only file system\. Give a folder") as caught:
        RunDirectory.create(tmp_path / "run", CONFIG, {})
    assert caught.value.errno == errno.EROFS


def test_create_on_a_full_disk_leaves_no_half_made_run(tmp_path: Path) -> None:
    path = tmp_path / "run"
    original = storage.atomic_write

    # The configuration still fits, the manifest no longer does.
    def no_room_for_manifest(target: Path, data: bytes) -> None:
        if target.name == "manifest.json":
            full_disk_at(target.with_name(".manifest.json.tmp"))
        original(target, data)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("tlr_exp.records.directory.atomic_write", no_room_for_manifest)
        with pytest.raises(StorageError, match="No space left on device"):
            RunDirectory.create(path, CONFIG, {})
    assert not path.exists()


def test_create_refuses_what_yaml_cannot_hold(tmp_path: Path) -> None:
    with pytest.raises(RunDirectoryError, match="not plain data"):
        RunDirectory.create(tmp_path / "run", {"x": object()}, {})
    assert not (tmp_path / "run").exists()


def test_open_says_what_a_run_directory_is(run: RunDirectory, tmp_path: Path) -> None:
    with pytest.raises(RunDirectoryError, match=r"is not a directory.*metrics\.jsonl"):
        RunDirectory.open(tmp_path / "nowhere")
    with pytest.raises(RunDirectoryError, match=r"has no manifest\.json.*holds these runs: gwo"):
        RunDirectory.open(run.path.parent)
    (run.path / "manifest.json").write_text('{"run_id": ')
    with pytest.raises(RunDirectoryError, match=r"cannot read .*manifest\.json"):
        RunDirectory.open(run.path)
    (run.path / "manifest.json").write_text("[1]")
    with pytest.raises(RunDirectoryError, match="holds a list, not a record"):
        RunDirectory.open(run.path)


def test_status_keeps_identity_and_takes_extras(run: RunDirectory) -> None:
    before = run.manifest
    run.set_status("finished", best=40)
    after = run.manifest
    assert (after["status"], after["best"]) == ("finished", 40)
    assert after["run_id"] == before["run_id"]
    assert after["updated_at"] > before["updated_at"]
    with pytest.raises(ValueError, match=r"'done'.*running, finished, failed, interrupted"):
        run.set_status("done")


def test_full_disk_at_a_status_keeps_the_old_manifest(run: RunDirectory) -> None:
    before = (run.path / "manifest.json").read_bytes()
    full_disk_at(run.path / ".manifest.json.tmp")
    with pytest.raises(StorageError, match=r"cannot write .*manifest\.json: No space.*resume"):
        run.set_status("finished")
    assert (run.path / "manifest.json").read_bytes() == before
    assert not list(run.path.glob(".*"))


# --- metrics ---------------------------------------------------------------------------------
names = st.text(min_size=1).filter(lambda name: name not in ("iteration", "wall_time"))
values = st.floats() | st.integers(-(2**53), 2**53)


@settings(deadline=None, max_examples=60)
@given(lines=st.lists(st.dictionaries(names, values, max_size=5), max_size=6))
def test_metrics_round_trip(tmp_path_factory: pytest.TempPathFactory, lines: list[dict]) -> None:
    run = RunDirectory(tmp_path_factory.mktemp("run"))
    for iteration, metrics in enumerate(lines):
        run.log(iteration, metrics)
    back = run.metrics()
    assert [row.pop("iteration") for row in back] == list(range(len(lines)))
    assert all(abs(row.pop("wall_time") - time.time()) < 60 for row in back)
    for row, metrics in zip(back, lines, strict=True):
        assert row.keys() == metrics.keys()
        for name, value in metrics.items():
            if math.isfinite(value):
                assert row[name] == value
            else:
                assert math.isnan(row[name])


def test_lines_are_portable_json_and_one_an_iteration(run: RunDirectory) -> None:
    run.log(0, {"a": math.nan, "b": -math.inf, "c": True})
    run.log(1, {"a": 1.5})
    lines = (run.path / "metrics.jsonl").read_text().splitlines()
    first = json.loads(lines[0], parse_constant=pytest.fail)
    assert len(lines) == 2
    assert (first["a"], first["b"], first["c"]) == (None, None, 1)


def test_log_names_the_metric_it_refuses(run: RunDirectory) -> None:
    with pytest.raises(ValueError, match="'loss' is str, not one number"):
        run.log(0, {"loss": "high"})  # pyright: ignore[reportArgumentType]
    with pytest.raises(ValueError, match="'iteration' is reserved"):
        run.log(0, {"iteration": 1})
    assert run.metrics() == []


def test_log_takes_numpy_and_tensor_scalars(run: RunDirectory) -> None:
    import numpy as np
    import torch

    run.log(0, {"n": np.float32(0.5), "i": np.int64(7), "t": torch.tensor([2.0])})  # type: ignore[dict-item]
    row = run.metrics()[0]
    assert (row["n"], row["i"], row["t"]) == (0.5, 7.0, 2.0)
    with pytest.raises(ValueError, match="'t' is Tensor, not one number"):
        run.log(1, {"t": torch.zeros(2)})  # type: ignore[dict-item]


def test_torn_last_line_is_passed_over_and_cut_off_by_the_next(run: RunDirectory) -> None:
    run.log(0, {"a": 1.0})
    run.log(1, {"a": 2.0})
    whole = run.metrics_path.read_bytes()
    run.metrics_path.write_bytes(whole[:-10])
    assert [row["iteration"] for row in run.metrics()] == [0]
    run.log(1, {"a": 3.0})
    assert [(row["iteration"], row["a"]) for row in run.metrics()] == [(0, 1.0), (1, 3.0)]


def test_zeros_that_a_power_cut_leaves_count_as_torn(run: RunDirectory) -> None:
    run.log(0, {"a": 1.0})
    with open(run.metrics_path, "ab") as file:
        file.write(b"\0" * 5000)
    assert [row["iteration"] for row in run.metrics()] == [0]
    run.log(1, {"a": 1.0})
    assert [row["iteration"] for row in run.metrics()] == [0, 1]


def test_damage_in_the_middle_is_named(run: RunDirectory) -> None:
    for iteration in range(3):
        run.log(iteration, {"a": 1.0})
    lines = run.metrics_path.read_bytes().splitlines(keepends=True)
    run.metrics_path.write_bytes(lines[0] + b"{broken\n" + lines[2])
    with pytest.raises(
        DamagedMetricsError, match=rf"metrics\.jsonl: the line at byte {len(lines[0])} .*broken"
    ):
        run.metrics()


def test_iteration_logged_twice_counts_once(run: RunDirectory) -> None:
    for iteration, value in [(0, 1.0), (2, 2.0), (1, 3.0), (2, 4.0)]:
        run.log(iteration, {"a": value})
    assert [(r["iteration"], r["a"]) for r in run.metrics()] == [(0, 1.0), (1, 3.0), (2, 4.0)]


@pytest.mark.parametrize(("last", "left"), [(-1, []), (2, [0, 1, 2]), (9, [0, 1, 2, 3, 4])])
def test_truncate_after(run: RunDirectory, last: int, left: list[int]) -> None:
    run.truncate_after(last)  # nothing logged yet: nothing to do
    for iteration in range(5):
        run.log(iteration, {"a": math.nan, "b": 0.1})
    before = run.metrics()
    run.truncate_after(last)
    after = run.metrics()
    assert [row["iteration"] for row in after] == left
    assert [row["wall_time"] for row in after] == [r["wall_time"] for r in before[: len(left)]]
    assert all(math.isnan(row["a"]) and row["b"] == 0.1 for row in after)
    run.log(last + 1, {"b": 0.2})
    assert run.metrics()[-1]["b"] in (0.1, 0.2)


def test_truncation_that_does_not_fit_changes_nothing(run: RunDirectory) -> None:
    for iteration in range(3):
        run.log(iteration, {"a": 1.0})
    full_disk_at(run.path / ".metrics.jsonl.tmp")
    with pytest.raises(StorageError, match="No space left"):
        run.truncate_after(0)
    assert len(run.metrics()) == 3


def test_full_disk_at_a_line_says_which_file_and_how_to_go_on(run: RunDirectory) -> None:
    full_disk_at(run.metrics_path)
    with pytest.raises(StorageError, match=r"metrics\.jsonl: No space left.*intact.*resume"):
        run.log(0, {"a": 1.0})


def test_line_that_fits_in_part_is_taken_back(
    run: RunDirectory, monkeypatch: pytest.MonkeyPatch
) -> None:
    run.log(0, {"a": 1.0})
    before = run.metrics_path.read_bytes()
    write = os.write
    monkeypatch.setattr(os, "write", lambda descriptor, data: write(descriptor, data[:7]))
    with pytest.raises(StorageError, match="No space left"):
        run.log(1, {"a": 1.0})
    assert run.metrics_path.read_bytes() == before


def test_reading_on_from_an_offset_leaves_the_unfinished_line(run: RunDirectory) -> None:
    assert read_metrics(run.metrics_path) == ([], 0)
    run.log(0, {"a": 1.0})
    rows, offset = read_metrics(run.metrics_path)
    assert (len(rows), offset) == (1, run.metrics_path.stat().st_size)
    with open(run.metrics_path, "ab") as file:
        file.write(b'{"iteration": 1, "wall_')
    assert read_metrics(run.metrics_path, offset) == ([], offset)
    with open(run.metrics_path, "ab") as file:
        file.write(b'time": 1.0}\n')
    rows, _ = read_metrics(run.metrics_path, offset)
    assert [row["iteration"] for row in rows] == [1]


@given(data=st.binary(max_size=300), line=st.binary(max_size=20).filter(lambda b: b"\n" not in b))
@settings(deadline=None, max_examples=50)
def test_appending_keeps_whole_lines_only(
    tmp_path_factory: pytest.TempPathFactory, data: bytes, line: bytes
) -> None:
    path = tmp_path_factory.mktemp("append") / "file"
    path.write_bytes(data)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(storage, "_TAIL_BYTES", 7)  # so that the search takes several steps
        append_line(path, line)
    assert path.read_bytes() == data[: data.rfind(b"\n") + 1] + line + b"\n"


def test_killed_writer_leaves_every_line_but_the_last_whole(run: RunDirectory) -> None:
    writer = """
        import sys
        from tlr_exp.records.run_directory import RunDirectory
        run = RunDirectory(__import__("pathlib").Path(sys.argv[1]))
        for iteration in range(10**9):
            run.log(iteration, {f"m{i}": i / 7 for i in range(300)})
            if iteration == 5:
                print("writing", flush=True)
    """
    process = start_python(writer, str(run.path))
    assert process.stdout is not None
    process.stdout.readline()
    time.sleep(0.05)
    kill(process)
    iterations = [row["iteration"] for row in run.metrics()]
    assert iterations == list(range(len(iterations)))
    assert len(iterations) >= 6


def test_flush(run: RunDirectory, monkeypatch: pytest.MonkeyPatch) -> None:
    run.flush()
    run.log(0, {"a": 1.0})
    synced = []
    monkeypatch.setattr(os, "fsync", lambda descriptor: synced.append(os.fstat(descriptor).st_ino))
    run.flush()
    assert synced == [run.metrics_path.stat().st_ino]


# --- one process at a time -------------------------------------------------------------------
def test_lock_keeps_others_out_and_frees_itself_when_its_holder_is_killed(
    run: RunDirectory,
) -> None:
    holder = """
        import sys, time
        from tlr_exp.records.run_directory import RunDirectory
        run = RunDirectory.open(sys.argv[1])
        with run.lock():
            run.set_status("running")
            print("locked", flush=True)
            time.sleep(60)
    """
    assert not run.is_live()
    process = start_python(holder, str(run.path))
    assert process.stdout is not None
    process.stdout.readline()
    assert run.is_live()
    with (
        pytest.raises(RunDirectoryError, match=f"in use by another process.*{process.pid}"),
        run.lock(timeout_s=0.1),
    ):
        pytest.fail("two processes hold one run")
    kill(process)
    assert not run.is_live()
    with run.lock(timeout_s=0.1):
        assert run.is_live()


def test_lock_holds_within_one_process_too(run: RunDirectory) -> None:
    other = RunDirectory.open(run.path)
    with (
        run.lock(),
        pytest.raises(RunDirectoryError, match="in use"),
        other.lock(timeout_s=0.05),
    ):
        pytest.fail("locked twice")
    with other.lock(timeout_s=0.05):
        pass


def test_looking_whether_a_run_is_live_never_spoils_its_lock(run: RunDirectory) -> None:
    looker = """
        import sys
        from tlr_exp.records.run_directory import RunDirectory
        run = RunDirectory.open(sys.argv[1])
        print("looking", flush=True)
        while True:
            run.is_live()
    """
    with run.lock():
        pass  # makes the lock file
    process = start_python(looker, str(run.path))
    assert process.stdout is not None
    process.stdout.readline()
    for _ in range(30):
        with run.lock():
            pass
    kill(process)


# --- atomic writes and provenance ------------------------------------------------------------
def test_atomic_write_replaces_and_leaves_nothing_else(tmp_path: Path) -> None:
    path = tmp_path / "file"
    atomic_write(path, b"one")
    atomic_write(path, memoryview(b"two"))
    assert path.read_bytes() == b"two"
    assert list(tmp_path.iterdir()) == [path]


def test_atomic_write_is_on_disk_before_it_has_the_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    events = []
    fsync, replace = os.fsync, os.replace
    monkeypatch.setattr(os, "fsync", lambda d: (events.append("fsync"), fsync(d))[1])
    monkeypatch.setattr(os, "replace", lambda a, b: (events.append("rename"), replace(a, b))[1])
    atomic_write(tmp_path / "file", b"data")
    assert events == ["fsync", "rename", "fsync"]


def test_git_state(tmp_path: Path) -> None:
    assert git_state(tmp_path) is None
    assert git_state(tmp_path / "missing") is None

    def git(*arguments: str) -> str:
        identity = ["-c", "user.name=n", "-c", "user.email=e@example.org"]
        command = ["git", *identity, *arguments]
        return subprocess.run(
            command, cwd=tmp_path, check=True, capture_output=True, text=True
        ).stdout.strip()

    git("init", "--quiet")
    assert git_state(tmp_path) is None  # no commit yet
    (tmp_path / "a").write_text("1")
    git("add", "a")
    git("commit", "--quiet", "-m", "first")
    (tmp_path / "untracked").write_text("")
    assert git_state(tmp_path) == {"commit": git("rev-parse", "HEAD"), "dirty": False}
    (tmp_path / "a").write_text("2")
    assert git_state(tmp_path) == {"commit": git("rev-parse", "HEAD"), "dirty": True}


def test_versions_and_machine() -> None:
    versions = package_versions(("pytest", "no-such-distribution"))
    assert versions == {"pytest": pytest.__version__}
    assert machine("cuda:0")["device"] == "cuda:0"
    assert machine(None)["cpu_model"]


def test_module_is_light() -> None:
    code = """
        import sys, tlr_exp.records.run_directory, tlr_exp.records.runs, tlr_exp.mlflow_sync.mirror
        heavy = {"torch", "mlflow", "numpy", "yaml", "hydra", "jax", "mujoco"} & set(sys.modules)
        print(sorted(heavy))
    """
    process = start_python(code)
    assert process.communicate()[0].strip() == "[]"


def test_a_path_that_is_no_text_is_kept(tmp_path):
    """Bytes that are no UTF-8 stand in a path as lone surrogates."""
    motion = os.fsdecode(b"/motions/bad\xff/walk.npz")
    config = {"env": {"motion": motion}}
    run = RunDirectory.create(tmp_path / "run", config, {}, "00112233", {motion: "1"})
    opened = RunDirectory.open(run.path)
    assert opened.config["env"]["motion"] == motion
    assert opened.manifest["files"] == {motion: "1"}
