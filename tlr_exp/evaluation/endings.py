"""Why training would have ended an episode, and when."""

import numpy as np

from tlr_exp.keys import Ending


def ending(unstable: np.ndarray, tilted: np.ndarray, far: np.ndarray) -> Ending:
    """The kind of the first failure; of several in one step the first in this order.

    Args:
        unstable, tilted, far: whether each step failed in this way, [T] bool.
    """
    failed = unstable | tilted | far
    if not failed.any():
        return Ending.COMPLETED
    first = int(np.argmax(failed))
    if unstable[first]:
        return Ending.UNSTABLE
    return Ending.FELL if tilted[first] else Ending.TOO_FAR


def share_before_first(event: np.ndarray) -> float:
    """Share of the steps before the first true one; 1 where none is. ``event``: [T] bool, T > 0."""
    return int(np.argmax(event)) / len(event) if event.any() else 1.0
