"""A run in miniature whose policy is exported."""

import dataclasses
from pathlib import Path

import pytest
from learners import build_training

from tlr_exp.records.run_directory import RunDirectory

TINY = (
    "scale.num_envs=16",
    "scale.iterations=4",
    "scale.evaluate_every=2",
    "scale.checkpoint_every=1",
    "ppo.num_steps=4",
    "ppo.hidden_sizes=[16]",
    "num_threads=1",
    "physics.num_threads=1",
    "runs_dir=/home/ann/runs",
    "tracking_uri=http://srv.lab:5000",
)


@pytest.fixture(scope="session")
def trained_run(settings_of, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Four iterations on the short motion; evaluated after the second and the last. Only read."""
    settings = settings_of(*TINY)
    run = RunDirectory.create(
        tmp_path_factory.mktemp("runs") / "tiny-run",
        dataclasses.asdict(settings),
        tags={"method": "gwo", "motion": settings.env.motion},
        identity="0123abcd",
        files={"env.motion": "a hash"},
    )
    build_training(settings, run).train()
    return run.path
