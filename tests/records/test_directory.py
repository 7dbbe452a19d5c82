"""What runs and sweeps have in common: a killed one is noticed, and reading costs little."""

from pathlib import Path

from tlr_exp.records.run_directory import RunDirectory
from tlr_exp.records.storage import atomic_write, while_unchanged
from tlr_exp.records.sweep_directory import SweepDirectory


def test_running_without_its_lock_is_interrupted(tmp_path: Path) -> None:
    run = RunDirectory.create(tmp_path / "study" / "a", {}, {})
    sweep = SweepDirectory.prepare(tmp_path / "study", "two", "0011aabb")
    sweep.begin("tlr-train -m", 1)
    for folder in (run, sweep):
        with folder.lock():
            assert folder.status == "running"
        assert (folder.status, folder.manifest["status"]) == ("interrupted", "running")
        folder.set_status("failed")
        assert folder.status == "failed"


def test_a_sweep_stands_for_the_runs_of_its_jobs(tmp_path: Path) -> None:
    run = RunDirectory.create(tmp_path / "study" / "a", {}, {"experiment": "study"})
    sweep = SweepDirectory.prepare(tmp_path / "study", "two", "0011aabb")
    sweep.begin("tlr-train -m", 1)
    sweep.write_job(0, "running", run="a", run_id=run.manifest["run_id"])
    assert (run.study, sweep.study) == ("study", "study")
    assert run.study_folder == sweep.study_folder == tmp_path / "study"
    assert (run.runs_of_jobs(), sweep.runs_of_jobs()) == ([], [run.path])
    assert not sweep.has_live_runs()
    with run.lock():
        assert sweep.has_live_runs()


def test_a_file_is_read_again_only_once_it_has_changed(tmp_path: Path) -> None:
    path, reads = tmp_path / "file", []

    @while_unchanged
    def content(path: Path) -> str:
        reads.append(path)
        return path.read_text() if path.exists() else ""

    assert (content(path), len(reads)) == ("", 1)
    for text in ("one", "two"):  # of one length
        atomic_write(path, text.encode())
        before = len(reads)
        assert [content(path), content(path)] == [text, text]
        assert len(reads) == before + 1
    path.unlink()
    assert content(path) == ""
