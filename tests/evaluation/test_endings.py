"""Why and when an episode would have ended."""

import numpy as np
import pytest

from tlr_exp.evaluation.endings import ending, share_before_first
from tlr_exp.keys import Ending

NEVER = np.zeros(4, dtype=bool)


def at(step: int) -> np.ndarray:
    return np.arange(4) == step


@pytest.mark.parametrize(
    ("unstable", "tilted", "far", "kind"),
    [
        (NEVER, NEVER, NEVER, Ending.COMPLETED),
        (NEVER, at(2), at(1), Ending.TOO_FAR),
        (NEVER, at(1), at(2), Ending.FELL),
        (NEVER, at(3), at(3), Ending.FELL),
        (at(0), at(0), at(0), Ending.UNSTABLE),
        (at(3), at(2), NEVER, Ending.FELL),
    ],
)
def test_the_first_failure_names_the_ending(unstable, tilted, far, kind):
    assert ending(unstable, tilted, far) is kind


@pytest.mark.parametrize(
    ("event", "share"),
    [([False] * 4, 1.0), ([True] + [False] * 3, 0.0), ([False, False, True, False], 0.5)],
)
def test_share_before_first(event, share):
    assert share_before_first(np.array(event)) == share
