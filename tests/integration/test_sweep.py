"""Sweeps that fail, are stopped, are killed and started again, by two at once too."""

import json
import os
import signal

import pytest

from tests.integration.sweeper import LAST
from tests.patience import HANG_S, wait_for
from tlr_exp.records.directory import FINISHED, INTERRUPTED
from tlr_exp.records.sweep_directory import SweepDirectory


def test_a_job_that_diverges_and_one_that_is_killed_leave_the_others_alone(sweeper):
    # At a learning rate of 1e10 a loss overflows; job 1 is killed, as for want of memory.
    process = sweeper.start(
        "hydra/launcher=local",
        "ppo.max_learning_rate=1e10",
        "ppo.learning_rate=1e10,1e-3,2e-3",
    )

    def process_to_kill() -> int | None:
        for sweep in SweepDirectory.find(sweeper.folder):
            for job in sweep.jobs():
                if job.num == 1 and job.status == "running":
                    return job.pid
        return None

    sweeper.wait(lambda: process_to_kill() is not None, process)
    os.kill(process_to_kill(), signal.SIGKILL)
    status, output = sweeper.end(process)
    assert status == 1, output
    assert sweeper.statuses == ["failed", "failed", "finished"], output
    diverged, killed, _ = sweeper.sweep.jobs()
    assert "NonFiniteLossError" in diverged.error
    assert "killed by SIGKILL" in killed.error
    assert "failed: 0, 1" in output
    for job in (diverged, killed):
        assert f"job {job.num} failed: {job.error}"[:60] in output
        assert f"runs/tlr/{job.run}/train.log" in output
    assert sweeper.sweep.status == "failed"


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
    before = [run.metrics()[0] for run in sweeper.runs]

    first, second = sweeper.start(*command), sweeper.start(*command)
    ended = [sweeper.end(first), sweeper.end(second)]
    assert [status for status, _ in ended] == [0, 0], ended
    assert [run.status for run in sweeper.runs] == [FINISHED] * 2
    assert [run.metrics()[0] for run in sweeper.runs] == before  # gone on with, not begun again
    assert sweeper.lines() == [LAST, LAST]
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
    process.communicate(timeout=HANG_S)
    wait_for(lambda: not any(run.is_live() for run in sweeper.runs))
    assert sweeper.sweep.status == INTERRUPTED
    assert [run.status for run in sweeper.runs] == [INTERRUPTED] * 2
    assert all(list((run.path / "checkpoints").glob("*.pt")) for run in sweeper.runs)


def test_mistakes_in_any_job_are_told_before_any_starts(sweeper):
    status, output = sweeper.run("scale.num_envs=5,16", "scale.iterations=1")
    assert status == 2
    assert "job 0 (scale.num_envs=5): reward.objective: threshold_share 0.1 of num_envs 5" in output
    assert "less than one candidate" in output
    assert sweeper.runs == []
    assert SweepDirectory.find(sweeper.folder) == []


@pytest.mark.parametrize(
    ("override", "words"),
    [
        (
            "ppo.gamma=interval(0,1)",
            "ppo.gamma=interval(0,1): a sweep needs single values",
        ),
        ("hydra/sweeper=basic", "hydra/sweeper: a sweep of tlr-train knows all of its jobs"),
    ],
)
def test_what_no_sweep_can_be_is_told_by_the_command(sweeper, override, words):
    status, output = sweeper.run(override)
    assert status == 2, output
    assert words in output
    assert "Traceback" not in output
    assert sweeper.runs == []
    assert SweepDirectory.find(sweeper.folder) == []
