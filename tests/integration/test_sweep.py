"""Sweeps that fail, are stopped, are killed and started again, by two at once too."""

import json
import os
import signal
import time
from pathlib import Path

import pytest

from tests.integration.sweeper import LAST, Sweeper
from tlr_exp.records.run_directory import FINISHED, INTERRUPTED, RunDirectory
from tlr_exp.records.sweep_directory import find_sweeps


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
    assert sweeper.statuses == ["finished", "failed", "failed"], output
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
    assert sweeper.statuses == ["finished", "finished", "failed"]
    assert len(sweeper.runs) == 3
    assert killed.metrics()[0] == before  # the first iteration was not made again
    assert [line["iteration"] for line in killed.metrics()] == list(range(1, LAST + 1))


def test_ctrl_c_stops_all_jobs_and_two_people_at_once_make_no_duplicate(sweeper):
    command = ("+sweep=five_seeds", "seed=0", "hydra/launcher=local")
    process = sweeper.start(*command)
    sweeper.wait(lambda: len(sweeper.lines()) == 2 and sweeper.lines()[0] > 0, process)
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


def test_nothing_of_a_killed_sweep_lives_on(sweeper):
    process = sweeper.start("seed=0,1", "hydra/launcher=local", "scale.iterations=100000")
    sweeper.wait(lambda: len(sweeper.lines()) == 2 and sweeper.lines()[0] > 0, process)
    process.kill()
    # Ends once the last process that can write to it does, joblib's workers included.
    process.communicate(timeout=60)
    deadline = time.monotonic() + 60
    while any(run.is_live() for run in sweeper.runs):
        assert time.monotonic() < deadline, "an orphan goes on"
        time.sleep(0.1)
    assert sweeper.sweep.status == INTERRUPTED
    assert [run.status for run in sweeper.runs] == [INTERRUPTED] * 2
    assert all(list((run.path / "checkpoints").glob("*.pt")) for run in sweeper.runs)


def test_mistakes_in_any_job_are_told_before_any_starts(sweeper):
    status, output = sweeper.run("scale.num_envs=5,16", "scale.iterations=1")
    assert status == 2
    assert "job 0 (scale.num_envs=5): reward.objective.threshold_share 0.1" in output
    assert "no candidate" in output
    assert sweeper.runs == []
    assert find_sweeps(sweeper.folder) == []
