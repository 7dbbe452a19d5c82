"""The command around a sweep: whose turn it is, what a script is told, a terminal left in order."""

import subprocess
import sys
import time
from types import SimpleNamespace

import pytest
from omegaconf import OmegaConf

from tlr_exp.config.load import ConfigError
from tlr_exp.errors import UserError
from tlr_exp.records.storage import StorageError
from tlr_exp.records.sweep_directory import SWEEP_LOCK, SweepDirectory
from tlr_exp.sweeps import command
from tlr_exp.sweeps.command import ANSWER_VARIABLE, run_sweep
from tlr_exp.sweeps.launching import Launcher
from tlr_exp.sweeps.parallel import LauncherError

HOLD = "import filelock, sys\nwith filelock.FileLock(sys.argv[1]):\n print(1, flush=True); input()"


class Display:
    """Takes everything and notes whether it is open: while it is, a terminal has no cursor."""

    made: list["Display"]

    def __init__(self, name, slots) -> None:
        self.open, self.said = True, []
        self.made.append(self)

    def say(self, line: str) -> None:
        self.said.append(line)

    def show(self, states, note: str) -> None:
        pass

    def close(self) -> None:
        self.open = False


@pytest.fixture
def displays(monkeypatch):
    """All displays that were made."""
    Display.made = []
    monkeypatch.setattr(command, "make_sweep_display", Display)
    return Display.made


@pytest.fixture
def run(plan, monkeypatch):
    """``run()``: the exit status of the command for the plan, whose launcher finishes every job."""

    class Finishing(Launcher):
        def __init__(self, config, context, plan) -> None:
            super().__init__()
            self.sweep = SweepDirectory(plan.path)

        def launch(self, jobs, stopper, say) -> None:
            for job in jobs:
                self.sweep.write_job(job.num, "finished")

    monkeypatch.setattr(command, "make_plan", lambda config: plan)
    monkeypatch.setattr(command, "HydraLauncher", Finishing)
    config = OmegaConf.create({"hydra": {"launcher": {"_target_": "a.BasicLauncher"}}})
    return lambda: run_sweep(config, None)


def sleep_by(sleep, monkeypatch) -> None:
    """Let the command alone sleep so: locks do, too."""
    replaced = SimpleNamespace(sleep=sleep, monotonic=time.monotonic)
    monkeypatch.setattr(command, "time", replaced)


def test_a_script_is_told_which_directory_it_asked_for_whatever_is_newer(
    run, plan, make_run, tmp_path, monkeypatch, capsys
):
    for job in plan.jobs:
        make_run(job.num, "finished")
    monkeypatch.chdir(tmp_path)
    expected = f"runs/tlr/sweeps/five_seeds-{plan.sweep_id}"
    monkeypatch.setenv(ANSWER_VARIABLE, str(tmp_path / "answer"))
    for _ in range(2):  # the second time it is finished, and nothing in it is touched
        assert run() == 0
        assert (tmp_path / "answer").read_text() == f"{expected}\n"
        assert f"sweep directory  {expected}\n" in capsys.readouterr().out
        (tmp_path / "answer").unlink()
        (tmp_path / "runs/tlr/sweeps/five_seeds-ffffffff").mkdir(exist_ok=True)


def test_a_file_that_cannot_be_written_is_told_before_anything_starts(
    run, plan, tmp_path, monkeypatch, capsys
):
    monkeypatch.setenv(ANSWER_VARIABLE, str(tmp_path / "nowhere" / "answer"))
    assert run() == 1
    assert "nowhere" in capsys.readouterr().err
    assert SweepDirectory.prepare(plan.study_folder, plan.name, plan.sweep_id).jobs() == []


@pytest.mark.parametrize(
    ("error", "status"),
    [
        (ConfigError("seed is -1"), 2),
        (LauncherError("no partition"), 2),
        (UserError("walk.yaml holds no keyframes"), 1),
        (PermissionError(13, "Permission denied", "walk.npz"), 1),
    ],
)
def test_what_is_explained_is_told_in_a_line_as_of_a_single_run(
    run, monkeypatch, capsys, error, status
):
    def refuse(config):
        raise error

    monkeypatch.setattr(command, "make_plan", refuse)
    assert run() == status
    assert capsys.readouterr().err == f"tlr-train: {error}\n"


def test_ctrl_c_while_waiting_for_another_process_closes_the_display(
    run, sweep, displays, monkeypatch
):
    def interrupt(seconds: float) -> None:
        raise KeyboardInterrupt

    sleep_by(interrupt, monkeypatch)
    pipe = subprocess.PIPE
    holder = [sys.executable, "-c", HOLD, str(sweep.path / SWEEP_LOCK)]
    with subprocess.Popen(holder, stdin=pipe, stdout=pipe, text=True) as other:
        assert other.stdout is not None
        assert other.stdout.readline() == "1\n"
        assert run() == 130
        other.communicate("\n")
    assert [display.open for display in displays] == [False]
    assert "Ctrl-C does not stop it" in displays[0].said[0]


def test_the_display_of_the_waiting_closes_before_that_of_the_work_opens(
    run, sweep, displays, monkeypatch
):
    pipe = subprocess.PIPE
    holder = [sys.executable, "-c", HOLD, str(sweep.path / SWEEP_LOCK)]
    with subprocess.Popen(holder, stdin=pipe, stdout=pipe, text=True) as other:
        assert other.stdout is not None
        assert other.stdout.readline() == "1\n"
        sleep_by(lambda seconds: other.communicate("\n"), monkeypatch)
        begin = SweepDirectory.begin

        def noted(*arguments) -> None:
            assert [display.open for display in displays] == [False, True]
            begin(*arguments)

        monkeypatch.setattr(SweepDirectory, "begin", noted)
        assert run() == 0
    assert [display.open for display in displays] == [False, False]


@pytest.mark.parametrize("step", ["begin", "prepare"])
def test_what_fails_before_the_first_job_closes_the_display(
    run, displays, monkeypatch, capsys, step
):
    def full(*arguments) -> None:
        raise StorageError("sweep.json", OSError("the disk is full"), "make room")

    owner = SweepDirectory if step == "begin" else command.Session
    monkeypatch.setattr(owner, step, full)
    assert run() == 1
    assert "the disk is full" in capsys.readouterr().err
    assert [display.open for display in displays] == [False]
