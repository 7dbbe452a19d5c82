"""Fixtures of the importers' tests."""

from collections.abc import Callable
from pathlib import Path

import pytest
from foreign_files import WRITERS
from wild_files import WILD

from tlr_exp.motion.clip import MotionClip


@pytest.fixture(scope="session")
def motion_files(short_clip: MotionClip) -> dict[str, bytes]:
    return {name: write(short_clip) for name, write in (WRITERS | WILD).items()}


@pytest.fixture
def written(tmp_path: Path) -> Callable[[bytes], Path]:
    """``written(data)``: a file that holds the data, with a name that tells nothing."""

    def write(data: bytes) -> Path:
        path = tmp_path / "motion.bin"
        path.write_bytes(data)
        return path

    return write
