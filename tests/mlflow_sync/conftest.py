"""A run and an empty MLflow store."""

from pathlib import Path

import pytest
from stores import small_run

from tlr_exp.records.run_directory import RunDirectory


@pytest.fixture
def uri(database: Path) -> str:
    """An empty store of the test's own."""
    return f"sqlite:///{database}"


@pytest.fixture
def run(tmp_path: Path) -> RunDirectory:
    """A run without lines."""
    config = {"seed": 3, "ppo": {"gamma": 0.99, "hidden": [512, 256]}, "note": None, "empty": ""}
    path = tmp_path / "runs" / "gwo-s3"
    return small_run(path, config=config, method="gwo", scale="demo", device="cpu")
