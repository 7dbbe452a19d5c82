"""Sweeps on a real SLURM: warnings, cancelled and lost jobs, refusals, a queue that is left."""

import os
import re
import signal
from functools import partial

import pytest

from tests.cluster.slurm import Slurm
from tests.patience import wait_for

pytestmark = pytest.mark.cluster

SLURM = ("hydra/launcher=slurm", "hydra.launcher.timeout_min=30")
SHORT = ("scale.iterations=2", "scale.evaluate_every=2")
# Ended by whoever tests; checkpoints only where the training is asked for one.
LONG = (
    "scale.iterations=100000",
    "optimizer=fixed",
    "scale.checkpoint_every=100000",
    "scale.evaluate_every=100000",
)


def checkpoints(sweeper, num: int) -> list[int]:
    run = sweeper.sweep.study_folder / sweeper.sweep.job(num).run
    return sorted(int(path.stem) for path in (run / "checkpoints").glob("*.pt"))


def start_time_now(slurm: Slurm, element: str) -> None:
    """SLURM lets a job that it queued again wait two minutes."""
    wait_for(lambda: slurm.states().get(element) == "PENDING")
    slurm.ask("scontrol", "update", f"JobId={element}", "StartTime=now")


def test_jobs_train_and_people_can_tell_them_apart(slurm, sweeper):
    status, output = sweeper.run(*SHORT, *SLURM, "optimizer=fixed,gwo")
    assert status == 0, output
    assert sweeper.statuses == ["finished", "finished"]
    assert [run.status for run in sweeper.runs] == ["finished"] * 2
    assert sweeper.lines() == [2, 2]
    ids = [sweeper.element(num) for num in (0, 1)]
    wait_for(lambda: not slurm.ask("squeue", "-h").strip())
    wait_for(lambda: slurm.accounts(*ids) == ["COMPLETED|fixed tlr", "COMPLETED|gwo tlr"])
    for run in sweeper.runs:  # the command that repeats it alone
        words = run.manifest["command"].split()
        assert words[0] == "tlr-train"
        assert f"optimizer={run.manifest['tags']['method']}" in words


def test_a_warning_becomes_a_checkpoint_and_the_job_goes_on(slurm, sweeper):
    process = sweeper.start(*LONG, *SLURM, "seed=0")
    wait_for(lambda: sweeper.trains(0, lines=2), process)
    element = sweeper.element(0)
    # What SLURM sends before the end of the time.
    slurm.ask("scancel", "--batch", "--signal=USR2", element)
    wait_for(lambda: ") is queued again (BeginTime)" in sweeper.output, process)
    (saved,) = checkpoints(sweeper, 0)
    assert sweeper.iterations(0) == list(range(1, saved + 1))
    assert "1 queued again" in sweeper.output
    start_time_now(slurm, element)
    wait_for(lambda: len(sweeper.iterations(0)) > saved + 1, process)
    os.killpg(process.pid, signal.SIGINT)
    status, output = sweeper.end(process)
    assert status == 130, output
    after = sweeper.iterations(0)
    assert after == list(range(1, after[-1] + 1))
    assert checkpoints(sweeper, 0)[-1] == after[-1]


def test_a_job_that_runs_out_of_time_too_often_is_called_interrupted(slurm, sweeper):
    process = sweeper.start(*LONG, *SLURM, "seed=0", "hydra.launcher.max_num_timeout=0")
    wait_for(lambda: sweeper.trains(0), process)
    slurm.ask("scancel", "--batch", "--signal=USR2", sweeper.element(0))
    status, output = sweeper.end(process)
    assert status == 1, output
    assert sweeper.statuses == ["interrupted"]
    assert "job 0 interrupted: ran out of its time (30 min) 1 times; repeat" in output
    assert checkpoints(sweeper, 0)


def test_a_cancelled_job_saves_what_it_has_and_leaves_the_others_alone(slurm, sweeper):
    process = sweeper.start(*LONG, *SLURM, "scale.iterations=10,100000")
    wait_for(lambda: sweeper.trains(1, lines=2), process)
    slurm.ask("scancel", sweeper.element(1))
    status, output = sweeper.end(process)
    assert status == 1, output
    assert sweeper.statuses == ["finished", "cancelled"]
    assert checkpoints(sweeper, 1) == [sweeper.iterations(1)[-1]]
    assert "cancelled: 1" in output
    assert "killed" not in output
    assert "failed:" not in output


def test_what_becomes_of_jobs_in_the_queue_is_said(slurm, sweeper):
    one_at_a_time = "hydra.launcher.array_parallelism=1"
    process = sweeper.start(*LONG, *SLURM, "seed=0,1,2", one_at_a_time)
    wait_for(lambda: sweeper.trains(0), process)
    slurm.ask("scancel", sweeper.element(1))
    wait_for(lambda: "job 1 (seed=1) was cancelled" in sweeper.output, process)
    slurm.ask("scontrol", "uhold", sweeper.element(2))
    wait_for(lambda: "job 2 (seed=2) is held (JobHeldUser)" in sweeper.output, process)
    assert re.search(r"ETA …  .* 1 held \(JobHeldUser\)", sweeper.output)
    # The node is lost, and what ran there with it.
    slurm.ask("scontrol", "update", "NodeName=node1", "State=DOWN", "Reason=test")
    wait_for(lambda: "job 0 (seed=0) is queued again" in sweeper.output, process)
    os.killpg(process.pid, signal.SIGTERM)
    status, output = sweeper.end(process)
    assert status == 130, output
    # What ran on the lost node may have written last that it was interrupted; it is queued.
    first, *others = sweeper.statuses
    assert first in ("waiting", "interrupted")
    assert others == ["cancelled", "waiting"]
    assert "broke down" not in output


def test_a_queue_that_is_left_is_named_and_watched_by_the_same_command(slurm, sweeper):
    slurm.ask("scontrol", "update", "PartitionName=main", "State=DOWN")
    six = (*SHORT, *SLURM, "seed=range(6)")  # MaxArraySize is 4
    process = sweeper.start(*six)
    wait_for(lambda: "PartitionDown" in sweeper.output, process)
    os.killpg(process.pid, signal.SIGINT)
    status, output = sweeper.end(process)
    assert status == 130, output
    assert "broke down" not in output
    (names,) = re.findall(r"^cancel them +scancel (.*)$", output, re.MULTILINE)
    first, second = (name.partition("_")[0] for name in names.split())
    assert names == f"{first}_[0-3] {second}_[0-1]"
    queued = slurm.states()
    assert list(queued.values()) == ["PENDING"] * 6
    # A person who does as told; and one who gives the command again.
    slurm.ask("scancel", f"{second}_[0-1]")
    again = sweeper.start(*six)
    wait_for(lambda: "4 of the jobs are in the queue already" in sweeper.output, again)
    slurm.ask("scontrol", "update", "PartitionName=main", "State=UP")
    status, output = sweeper.end(again)
    assert status == 0, output
    assert sweeper.lines() == [2] * 6
    arrays = [sweeper.element(num).partition("_")[0] for num in range(6)]
    assert arrays[:4] == [first] * 4
    assert arrays[4] == arrays[5]
    assert arrays[4] not in (first, second)


def test_a_killed_command_is_taken_up_where_it_was_and_nothing_trains_twice(slurm, sweeper):
    two = (*LONG, *SLURM, "seed=0,1", "resume=never")
    process = sweeper.start(*two)
    wait_for(lambda: sweeper.trains(0) and sweeper.trains(1), process)
    process.kill()
    process.wait()
    before = slurm.states()
    again = sweeper.start(*two)
    wait_for(lambda: "2 of the jobs are in the queue already" in sweeper.output, again)
    # Queued again, they go on with their runs, although the sweep asks for new ones.
    slurm.ask("scontrol", "requeue", sweeper.element(0))
    start_time_now(slurm, sweeper.element(0))
    lines = len(sweeper.iterations(0))
    wait_for(lambda: sweeper.trains(0, lines + 1), again)
    os.killpg(again.pid, signal.SIGINT)
    status, output = sweeper.end(again)
    assert status == 130, output
    assert set(slurm.states()) == set(before)
    assert len(sweeper.runs) == 2


@pytest.mark.parametrize(
    ("asked", "words"),
    [
        ("hydra.launcher.partition=nope", "SLURM: invalid partition specified: nope"),
        ("hydra.launcher.mem_gb=4000", "SLURM: Memory specification can not be satisfied"),
    ],
)
def test_a_refusal_is_told_in_slurms_words(slurm, sweeper, asked, words):
    status, output = sweeper.run(*SHORT, *SLURM, "seed=0,1", asked)
    assert status == 2, output
    assert words in output
    assert "repeat" not in output
    assert "broke down" not in output
    # SLURM keeps what it refused for want of memory as failed.
    assert not set(slurm.states().values()) & {"PENDING", "RUNNING"}


def test_a_request_that_no_node_can_meet_is_called_that(slurm, sweeper):
    process = sweeper.start(*SHORT, *SLURM, "seed=0", "hydra.launcher.partition=empty")
    told = ") waits, and will not start by itself: PartitionConfig"
    wait_for(lambda: told in sweeper.output, process)
    slurm.ask("scancel", sweeper.element(0))
    status, output = sweeper.end(process)
    assert status == 1, output
    assert sweeper.statuses == ["cancelled"]


def test_a_failed_training_has_failed_for_slurm_too(slurm, sweeper):
    # At a learning rate of 1e10 a loss overflows.
    wrong = ("ppo.max_learning_rate=1e10", "ppo.learning_rate=1e10")
    status, output = sweeper.run(*SLURM, *wrong)
    assert status == 1, output
    assert "NonFiniteLossError" in sweeper.sweep.job(0).error
    failed = partial(slurm.accounts, sweeper.element(0))
    wait_for(lambda: [row.partition("|")[0] for row in failed()] == ["FAILED"])
