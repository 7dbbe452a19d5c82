"""Launchers by their presets: jobs at once, threads of each, whether they outlive the sweep."""

import pytest
from omegaconf import OmegaConf

from tlr_exp.sweeps.parallel import Parallelism, parallelism


@pytest.mark.parametrize(
    ("overrides", "jobs", "expected"),
    [
        ([], 10, Parallelism(1, 8, False)),
        (["hydra/launcher=local"], 10, Parallelism(8, 1, False)),
        (["hydra/launcher=local"], 3, Parallelism(3, 2, False)),
        (["hydra/launcher=local", "hydra.launcher.n_jobs=-2"], 10, Parallelism(7, 1, False)),
        (["hydra/launcher=local", "hydra.launcher.n_jobs=2"], 10, Parallelism(2, 4, False)),
        (["hydra/launcher=local", "hydra.launcher.n_jobs=20"], 30, Parallelism(20, 1, False)),
        (["hydra/launcher=slurm", "hydra.launcher.cpus_per_task=3"], 4, Parallelism(None, 3, True)),
        (["hydra/launcher=slurm"], 10, Parallelism(None, 0, True)),
        (["hydra/launcher=ray_cluster"], 10, Parallelism(None, 1, False)),
        (
            ["hydra/launcher=ray_cluster", "hydra.launcher.ray.remote.num_cpus=4"],
            10,
            Parallelism(None, 4, False),
        ),
    ],
)
def test_presets(overrides, jobs, expected, multirun):
    launcher = OmegaConf.to_container(multirun(*overrides).hydra.launcher, resolve=False)
    assert parallelism(launcher, jobs, cores=8) == expected


def test_a_launcher_of_ones_own_counts_as_a_cluster():
    assert parallelism({"_target_": "a.b.Mine"}, 3, 8) == Parallelism(None, 0, True)
