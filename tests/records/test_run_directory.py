"""The run directory: what is written is whole, survives kills and full disks, and reads back."""

import errno
import os
from pathlib import Path

import pytest
from run_on_disk import CONFIG, full_disk_at, kill, start_python

from tlr_exp.records import storage
from tlr_exp.records.run_directory import RunDirectory, RunDirectoryError
from tlr_exp.records.storage import StorageError


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
