"""Episodes of a training, over its batches: how long they last, and how they end."""

from collections import deque

import torch
from torch import Tensor

from tlr_exp.keys import Ending


class EpisodeLengths:
    """Mean length, in control steps, of the last finished episodes.

    Args:
        num_envs: environments in a batch.
        window: how many of the last finished episodes count (100 in the paper's lineage).
    """

    def __init__(self, num_envs: int, window: int = 100) -> None:
        self.running = torch.zeros(num_envs, dtype=torch.int64)
        self.last: deque[int] = deque(maxlen=window)

    def add(self, done: Tensor) -> None:
        """Take in a batch: ``done`` [num_envs, num_steps] bool, true at an episode's last step."""
        for done_now in done.cpu().unbind(dim=1):
            self.running += 1
            self.last.extend(self.running[done_now].tolist())
            self.running[done_now] = 0

    @property
    def mean_length(self) -> float:
        """Mean of the last finished episodes; of the unfinished ones before any has finished."""
        if not self.last:
            return self.running.double().mean().item()
        return sum(self.last) / len(self.last)

    def state_dict(self) -> dict[str, object]:
        return {"running": self.running.clone(), "last": list(self.last)}

    def load_state_dict(self, state: dict) -> None:
        self.running = state["running"].clone()
        self.last = deque(state["last"], maxlen=self.last.maxlen)


def ending_shares(
    terminated: Tensor, truncated: Tensor, fell: Tensor, unstable: Tensor
) -> dict[Ending, float]:
    """Of the episodes that end in a batch the share that ends in each way; NaN where none ends.

    Args:
        terminated, truncated: whether a step ends its episode by a failure, or at the motion's end.
        fell, unstable: whether the robot has fallen, and its simulation is no longer finite. All
            bool, of one shape.
    """
    known = terminated & (fell | unstable)
    counts = {
        Ending.COMPLETED: truncated,
        Ending.FELL: known & ~unstable,
        Ending.TOO_FAR: terminated & ~known,
        Ending.UNSTABLE: terminated & unstable,
    }
    ended = (terminated | truncated).sum()
    return {kind: (count.sum() / ended).item() for kind, count in counts.items()}
