"""Plans without Hydra, and plans from its real configuration."""

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from hydra import initialize_config_module
from hydra.core.global_hydra import GlobalHydra
from hydra.types import RunMode
from omegaconf import DictConfig

from tlr_exp.records.run_directory import RunDirectory
from tlr_exp.records.sweep_directory import SweepDirectory
from tlr_exp.sweeps.parallel import Parallelism
from tlr_exp.sweeps.spec import JobSpec, Plan

ITERATIONS = 10


@pytest.fixture
def multirun() -> Iterator[Callable[..., DictConfig]]:
    """``multirun(*overrides)``: what Hydra composes for ``tlr-train -m`` with these."""
    with initialize_config_module("tlr_exp.conf", version_base="1.3"):
        hydra = GlobalHydra.instance().hydra
        assert hydra is not None

        def compose(*overrides: str) -> DictConfig:
            return hydra.compose_config(
                "config", list(overrides), run_mode=RunMode.MULTIRUN, with_log_configuration=False
            )

        yield compose


@pytest.fixture
def plan(tmp_path: Path) -> Plan:
    """Three jobs that need no real configuration."""
    config = {
        "seed": 0,
        "num_threads": 1,
        "resume": "in_sweeps",
        "scale": {"iterations": ITERATIONS},
    }
    jobs = tuple(
        JobSpec(num, config, "gwo", (f"seed={num}",), f"seed={num}", f"{num:08d}")
        for num in range(3)
    )
    return Plan(
        name="five_seeds",
        sweep_id="0011aabb",
        study="tlr",
        study_folder=tmp_path / "runs" / "tlr",
        description="Does it?",
        arms=("optimizer",),
        scale="demo",
        jobs=jobs,
        parallelism=Parallelism(1, 1, detached=False),
        uri=None,
    )


@pytest.fixture
def sweep(plan: Plan) -> SweepDirectory:
    """The directory of the plan, begun."""
    directory = SweepDirectory.prepare(plan.study_folder, plan.name, plan.sweep_id)
    directory.begin("tlr-train -m", len(plan.jobs))
    return directory


@pytest.fixture
def make_run(plan: Plan) -> Callable[..., RunDirectory]:
    """``make_run(num, status, iterations=0)``: the run of a job, as an earlier attempt left it."""

    def make(num: int, status: str, iterations: int = 0) -> RunDirectory:
        path = plan.study_folder / f"run{num}"
        run = RunDirectory.create(path, {"seed": num}, {}, plan.jobs[num].identity)
        for iteration in range(1, iterations + 1):
            run.log(iteration, {"train/loss": 1.0})
        run.set_status(status)
        return run

    return make
