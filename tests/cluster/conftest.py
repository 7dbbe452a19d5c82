"""Real clusters of one machine: a SLURM of one node, a Ray of two nodes, all on loopback."""

from __future__ import annotations

import json
import os
import subprocess
from collections.abc import Iterator

import pytest

from tests.cluster.slurm import Slurm, missing
from tests.integration.sweeper import Sweeper
from tests.trainer import Trainer


@pytest.fixture(scope="session")
def slurm_cluster(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Slurm]:
    if absent := missing():
        pytest.skip(f"no SLURM here ({', '.join(absent)}): make cluster-tools")
    if os.geteuid() != 0:
        pytest.skip("a SLURM node needs root to start jobs")
    with Slurm(tmp_path_factory.mktemp("slurm")) as cluster:
        yield cluster


class ClusterSweeper(Sweeper):
    """Sweeps whose output can be read while they go on."""

    def close(self) -> None:
        super().close()
        if not isinstance(self.stdout, int):
            self.stdout.close()

    @property
    def output(self) -> str:
        return (self.folder / "output").read_text()

    def start(self, *overrides: str) -> subprocess.Popen[str]:
        if isinstance(self.stdout, int):
            self.stdout = open(self.folder / "output", "a")  # noqa: SIM115 (closed by `close`)
        return super().start(*overrides)

    def end(self, process: subprocess.Popen[str]) -> tuple[int, str]:
        super().end(process)
        return process.returncode, self.output

    def element(self, num: int) -> str:
        """The id of the element that is job ``num``."""
        path = self.sweep.path / "launcher" / "slurm.json"
        return json.loads(path.read_text())[str(num)]

    def iterations(self, num: int) -> list[int]:
        """The iterations in the metrics of job ``num``, as they lie there."""
        run = self.sweep.study_folder / str(self.sweep.job(num).run)
        lines = (run / "metrics.jsonl").read_text().splitlines(keepends=True)
        return [json.loads(line)["iteration"] for line in lines if line.endswith("\n")]

    def trains(self, num: int, lines: int = 1) -> bool:
        """Whether job ``num`` runs and has so many lines of metrics."""
        try:
            job = self.sweep.job(num)
            return job.status == "running" and len(self.iterations(num)) >= lines
        except (OSError, ValueError):
            return False


@pytest.fixture
def sweeper(trainer: Trainer) -> Iterator[ClusterSweeper]:
    sweeper = ClusterSweeper(trainer)
    yield sweeper
    sweeper.close()


@pytest.fixture
def slurm(slurm_cluster: Slurm, sweeper: ClusterSweeper) -> Iterator[Slurm]:
    """The cluster, empty before and after, that the sweeper's commands submit to."""
    sweeper.environment = slurm_cluster.environment
    yield slurm_cluster
    slurm_cluster.call("scontrol", "update", "PartitionName=main", "State=UP")
    slurm_cluster.call("scontrol", "update", "NodeName=node1", "State=RESUME")
    slurm_cluster.clear()
