"""Sweeps on a Ray of two nodes: a lost node, signals, a request that no node can meet."""

import os
import signal
from collections.abc import Iterator
from importlib.util import find_spec

import pytest

from tests.cluster.ray_cluster import is_on_head, lose_node_of, two_raylets
from tests.patience import wait_for

pytestmark = [
    pytest.mark.cluster,
    pytest.mark.skipif(find_spec("ray") is None, reason="no Ray here: make cluster-tools"),
    # Ray's own processes and sockets, which its cluster for tests leaves to the collector.
    pytest.mark.filterwarnings("ignore::ResourceWarning"),
    pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning"),
    pytest.mark.filterwarnings("ignore::DeprecationWarning"),
    pytest.mark.filterwarnings("ignore::FutureWarning"),
]

LONG = (
    "scale.iterations=100000",
    "optimizer=fixed",
    "scale.checkpoint_every=100000",
    "scale.evaluate_every=100000",
)


@pytest.fixture
def cluster() -> Iterator:
    with two_raylets() as cluster:
        yield cluster


@pytest.fixture
def on_ray(cluster) -> tuple[str, ...]:
    return ("hydra/launcher=ray_cluster", f"hydra.launcher.ray.init.address={cluster.address}")


def saved_all(sweeper, num: int) -> bool:
    """Whether the last iteration of the job is in a checkpoint."""
    run = sweeper.sweep.study_folder / sweeper.sweep.job(num).run
    numbers = sorted(int(path.stem) for path in (run / "checkpoints").glob("*.pt"))
    return bool(numbers) and numbers[-1] == sweeper.iterations(num)[-1]


def test_a_lost_node_gives_its_job_to_another_and_sigterm_saves(sweeper, cluster, on_ray):
    process = sweeper.start(*LONG, *on_ray, "seed=0,1")
    wait_for(lambda: sweeper.trains(0) and sweeper.trains(1), process)
    pids = {num: sweeper.sweep.job(num).pid for num in (0, 1)}
    (lost,) = [num for num, pid in pids.items() if not is_on_head(cluster, pid)]
    lose_node_of(cluster, pids[lost])
    left = len(sweeper.iterations(lost))
    told = f"job {lost} (seed={lost}): its node was lost, another continues it"
    wait_for(lambda: told in sweeper.output, process)
    wait_for(lambda: "1 queued again (its node was lost)" in sweeper.output, process)
    # The node that is left has room for one: the other job waits for it.
    os.kill(sweeper.sweep.job(1 - lost).pid, signal.SIGINT)
    wait_for(lambda: sweeper.trains(lost, left + 1), process)
    os.killpg(process.pid, signal.SIGTERM)
    status, output = sweeper.end(process)
    assert status == 130, output
    assert sweeper.statuses == ["interrupted"] * 2
    assert len(sweeper.runs) == 2
    assert saved_all(sweeper, 0)
    assert saved_all(sweeper, 1)
    assert "raylet" not in output
    assert "Traceback" not in output


def test_jobs_train_on_a_ray_of_their_own(sweeper):
    short = ("scale.iterations=2", "scale.evaluate_every=2")
    status, output = sweeper.run(*short, "hydra/launcher=ray_cluster", "optimizer=fixed,gwo")
    assert status == 0, output
    assert sweeper.statuses == ["finished", "finished"]
    assert sweeper.lines() == [2, 2]
    assert "raylet" not in output


def test_a_request_that_no_node_can_meet_is_called_that(sweeper, on_ray):
    process = sweeper.start(*LONG, *on_ray, "seed=0", "hydra.launcher.ray.remote.num_gpus=7")
    told = ") waits, and will not start by itself: no node has 1 CPU, 7 GPU"
    wait_for(lambda: told in sweeper.output, process)
    os.killpg(process.pid, signal.SIGTERM)
    status, output = sweeper.end(process)
    assert status == 130, output
    assert sweeper.statuses == ["waiting"]
