"""Whole runs and sweeps in miniature, each in a folder of its own."""

from collections.abc import Iterator

import pytest

from tests.integration.sweeper import Sweeper
from tests.trainer import Trainer


@pytest.fixture
def sweeper(trainer: Trainer) -> Iterator[Sweeper]:
    sweeper = Sweeper(trainer)
    yield sweeper
    sweeper.close()
