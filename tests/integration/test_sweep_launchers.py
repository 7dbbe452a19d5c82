"""Sweeps by the launchers of clusters, as far as one machine can show them."""

import os
import signal
import time
from importlib.util import find_spec

import pytest
from tests.integration.fake_slurm import install, sbatch_flags

from tests.integration.sweeper import Sweeper

TWO = ("optimizer=fixed,gwo", "scale.iterations=2", "scale.evaluate_every=2")

needs_submitit = pytest.mark.skipif(
    find_spec("hydra_plugins.hydra_submitit_launcher") is None,
    reason="submitit is not installed: pip install 'tlr_exp[slurm]'",
)
needs_ray = pytest.mark.skipif(
    find_spec("hydra_plugins.hydra_ray_launcher") is None,
    reason="Ray is not installed: pip install 'tlr_exp[ray]'",
)


@pytest.fixture
def slurm(sweeper):
    """The folder of a pretended SLURM that the sweeper's commands find."""
    folder = sweeper.folder / "slurm"
    path = f"{folder}{os.pathsep}{os.environ['PATH']}"
    sweeper.environment = {**install(folder), "PATH": path}
    return folder


def assert_both_are_trained(sweeper: Sweeper, status: int, output: str) -> None:
    assert status == 0, output
    assert sweeper.statuses == ["finished", "finished"]
    assert [run.status for run in sweeper.runs] == ["finished"] * 2
    assert {run.manifest["tags"]["method"] for run in sweeper.runs} == {"fixed", "gwo"}
    assert sweeper.lines() == [2, 2]
    # The command that repeats the run alone, not that of the process which trained it.
    for run in sweeper.runs:
        words = run.manifest["command"].split()
        assert words[0] == "tlr-train"
        assert f"optimizer={run.manifest['tags']['method']}" in words


@needs_submitit
def test_submitit_on_this_machine(sweeper):
    status, output = sweeper.run(*TWO, "hydra/launcher=slurm_local")
    assert_both_are_trained(sweeper, status, output)


@needs_submitit
@pytest.mark.parametrize("how", ["Ctrl-C", "file"])
def test_slurm_gets_what_the_preset_says_and_a_stop_leaves_its_queue(sweeper, slurm, how):
    (slurm / "hold").touch()
    asked = ("hydra.launcher.partition=gpu", "hydra.launcher.gpus_per_node=1")
    process = sweeper.start(*TWO, "hydra/launcher=slurm", *asked)
    sweeper.wait((slurm / "submitted.sh").exists, process)
    time.sleep(2.0)  # until it waits for the jobs
    if how == "file":
        (sweeper.sweep.path / "stop").touch()
    else:
        os.killpg(process.pid, signal.SIGINT)
    status, output = sweeper.end(process)
    assert status == 130, output
    assert sweeper.statuses == ["waiting", "waiting"]
    assert (sweeper.sweep.path / "stop").exists()  # which they find when they start
    flags = sbatch_flags(slurm)
    expected = {
        "job-name": "tlr",
        "partition": "gpu",
        "gpus-per-node": "1",
        "cpus-per-task": "8",
        "mem": "16GB",
        "time": "240",
        "nodes": "1",
        "ntasks-per-node": "1",
        "array": "0-1%2",
        "signal": "USR2@120",
    }
    assert {name: flags.get(name) for name in expected} == expected
    assert "account" not in flags  # null leaves it to the cluster


@pytest.mark.slow
@needs_submitit
def test_tasks_of_slurm_train(sweeper, slurm):
    status, output = sweeper.run(*TWO, "hydra/launcher=slurm", "num_threads=1")
    assert_both_are_trained(sweeper, status, output)
    threads = [run.config["num_threads"] for run in sweeper.runs]
    assert threads == [1, 1]


@pytest.mark.slow
@needs_ray
def test_ray_on_this_machine(sweeper):
    status, output = sweeper.run(*TWO, "hydra/launcher=ray_cluster")
    assert_both_are_trained(sweeper, status, output)


@pytest.mark.skipif(
    find_spec("hydra_plugins.hydra_ray_launcher") is not None, reason="Ray is installed"
)
def test_a_launcher_that_is_not_installed_is_named_with_what_brings_it(sweeper):
    status, output = sweeper.run(*TWO, "hydra/launcher=ray_cluster")
    assert status == 2, output
    assert "pip install 'tlr_exp[ray]'" in output
    assert sweeper.runs == []
