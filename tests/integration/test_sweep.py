"""Whole sweeps in miniature: the real command, its jobs in processes of their own."""

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from tlr_exp.records.run_directory import FINISHED, INTERRUPTED, RunDirectory
from tlr_exp.records.sweep_directory import SweepDirectory, find_sweeps

LAST = 60
SWEEP = ("-m", "scale.num_envs=32", f"scale.iterations={LAST}", "scale.evaluate_every=60")


class Sweeper:
    """Runs sweeps with a trainer of one folder; every process in a group of its own."""

    def __init__(self, trainer) -> None:
        self.trainer = trainer
        self.folder: Path = trainer.folder

    def start(self, *overrides: str) -> subprocess.Popen[str]:
        given = [*SWEEP[1:], *(o for o in overrides if not o.startswith("-"))]
        return subprocess.Popen(
            [sys.executable, "-m", "tlr_exp.train", "-m", *self.trainer.arguments, *given],
            cwd=self.folder,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            start_new_session=True,
        )

    def run(self, *overrides: str) -> tuple[int, str]:
        return self.end(self.start(*overrides))

    def end(self, process: subprocess.Popen[str]) -> tuple[int, str]:
        output, _ = process.communicate(timeout=300)
        return process.returncode, output

    @property
    def sweep(self) -> SweepDirectory:
        (found,) = find_sweeps(self.folder)
        return found

    @property
    def runs(self) -> list[RunDirectory]:
        return [RunDirectory.open(path) for path in self.trainer.runs]

    def lines(self) -> list[int]:
        """Lines of metrics of each run."""
        return [run.metrics_path.read_bytes().count(b"\n") for run in self.runs if _has_lines(run)]

    def wait(self, condition: Callable[[], bool], process: subprocess.Popen[str]) -> None:
        deadline = time.monotonic() + 120
        while not condition():
            assert process.poll() is None, process.communicate()[0]
            assert time.monotonic() < deadline, "waited in vain"
            time.sleep(0.02)


def _has_lines(run: RunDirectory) -> bool:
    return run.metrics_path.exists()


@pytest.fixture
def sweeper(trainer) -> Sweeper:
    return Sweeper(trainer)


def test_failing_jobs_leave_the_others_alone_and_the_killed_one_is_resumed(sweeper):
    # A learning rate of 1e10 diverges; the second of the others is killed, as for want of memory.
    command = (
        "hydra/launcher=local",
        "ppo.max_learning_rate=1e10",
        "ppo.learning_rate=1e-3,2e-3,1e10",
    )
    process = sweeper.start(*command)

    def job_to_kill() -> int | None:
        for sweep in find_sweeps(sweeper.folder):
            for job in sweep.jobs():
                path = sweep.study_folder / str(job.run) / "checkpoints"
                if job.num == 1 and job.status == "running" and list(path.glob("*.pt")):
                    return job.pid
        return None

    sweeper.wait(lambda: job_to_kill() is not None, process)
    os.kill(job_to_kill(), signal.SIGKILL)
    status, output = sweeper.end(process)
    assert status == 1, output
    jobs = sweeper.sweep.jobs()
    assert [job.status for job in jobs] == ["finished", "failed", "failed"], output
    assert "killed by SIGKILL" in jobs[1].error
    assert "NonFiniteLossError" in jobs[2].error
    assert "failed: 1, 2" in output
    assert str(Path("runs/tlr") / jobs[2].run / "train.log") in output
    assert sweeper.sweep.status == "failed"
    killed = RunDirectory.open(sweeper.sweep.study_folder / jobs[1].run)
    before = killed.metrics()[0]

    status, output = sweeper.run(*command)
    assert status == 1
    assert "job 0 (ppo.learning_rate=1e-3) is trained already" in output.replace("0.001", "1e-3")
    assert [job.status for job in sweeper.sweep.jobs()] == ["finished", "finished", "failed"]
    assert len(sweeper.runs) == 3
    assert killed.metrics()[0] == before  # the first iteration was not made again
    assert [line["iteration"] for line in killed.metrics()] == list(range(1, LAST + 1))


def test_ctrl_c_stops_all_jobs_and_two_people_at_once_make_no_duplicate(sweeper):
    command = ("+sweep=five_seeds", "seed=0", "hydra/launcher=local")
    process = sweeper.start(*command)
    sweeper.wait(lambda: bool(sweeper.lines()) and min(sweeper.lines()) > 0, process)
    os.killpg(process.pid, signal.SIGINT)  # as a terminal does, to all of the group
    status, output = sweeper.end(process)
    assert status == 130, output
    assert "repeat the command" in output
    assert sweeper.sweep.status == INTERRUPTED
    for run in sweeper.runs:
        assert not run.is_live()
        assert run.status in (INTERRUPTED, FINISHED)
        assert list((run.path / "checkpoints").glob("*.pt"))

    first, second = sweeper.start(*command), sweeper.start(*command)
    ended = [sweeper.end(first), sweeper.end(second)]
    assert [status for status, _ in ended] == [0, 0], ended
    assert [run.status for run in sweeper.runs] == [FINISHED] * 2
    methods = sorted(run.manifest["tags"]["method"] for run in sweeper.runs)
    assert methods == ["fixed", "gwo"]
    record = json.loads((sweeper.sweep.path / "sweep.json").read_text())
    assert (record["status"], record["arms"], record["num_jobs"]) == (FINISHED, ["optimizer"], 2)
    assert record["description"].startswith("Does the two-layered reward track better")
    threads = {run.config["num_threads"] for run in sweeper.runs}
    assert threads == {1}


@pytest.mark.parametrize("launcher", ["basic", "local"])
def test_jobs_of_a_killed_sweep_save_and_end_by_themselves(sweeper, launcher):
    process = sweeper.start("seed=0,1", f"hydra/launcher={launcher}", "scale.iterations=100000")
    sweeper.wait(lambda: bool(sweeper.lines()) and max(sweeper.lines()) > 0, process)
    process.kill()
    process.communicate()
    deadline = time.monotonic() + 60
    while any(run.is_live() for run in sweeper.runs):
        assert time.monotonic() < deadline, "an orphan goes on"
        time.sleep(0.1)
    assert sweeper.sweep.status == INTERRUPTED
    assert all(run.status == INTERRUPTED for run in sweeper.runs)
    assert all(list((run.path / "checkpoints").glob("*.pt")) for run in sweeper.runs)


def test_mistakes_in_any_job_are_told_before_any_starts(sweeper):
    status, output = sweeper.run("scale.num_envs=5,16", "scale.iterations=1")
    assert status == 2
    assert "job 0 (scale.num_envs=5): reward.objective.threshold_share 0.1" in output
    assert "no candidate" in output
    assert sweeper.runs == []
    assert find_sweeps(sweeper.folder) == []
