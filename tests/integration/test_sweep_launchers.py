"""Launchers that are not there. Those of clusters: tests/cluster, on real ones."""

import shutil
from importlib.util import find_spec

import pytest


@pytest.mark.skipif(find_spec("ray") is not None, reason="Ray is installed")
def test_ray_that_is_not_installed_is_named_with_what_brings_it(sweeper):
    status, output = sweeper.run("seed=0,1", "hydra/launcher=ray_cluster")
    assert status == 2, output
    assert "Ray is not installed. In the folder of this project: python -m pip install" in output
    assert "--editable '.[ray]'" in output
    assert sweeper.runs == []


@pytest.mark.skipif(shutil.which("sbatch") is not None, reason="SLURM is installed")
def test_a_machine_without_slurm_is_called_that(sweeper):
    status, output = sweeper.run("seed=0,1", "hydra/launcher=slurm")
    assert status == 2, output
    assert "hydra/launcher=slurm: there is no sbatch here" in output
    assert "repeat" not in output
    assert sweeper.runs == []
