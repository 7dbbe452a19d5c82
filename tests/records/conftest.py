"""What tests of records share."""

from pathlib import Path

import pytest
from run_on_disk import CONFIG

from tlr_exp.records.run_directory import RunDirectory


@pytest.fixture
def run(tmp_path: Path) -> RunDirectory:
    return RunDirectory.create(tmp_path / "runs" / "gwo", CONFIG, {"method": "gwo"}, "0011aabb")
