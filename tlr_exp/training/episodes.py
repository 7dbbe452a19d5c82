"""Episodes of a training, over its batches: how long they last, and how they end."""

from collections import deque

import torch
from torch import Tensor

from tlr_exp.keys import Ending

# Control steps after a reset, beyond the first number and up to the second.
AGE_BANDS = ((0, 25), (25, 50), (50, 75), (75, 100))


class EpisodeLengths:
    """Mean length, in control steps, of the last finished episodes.

    Args:
        num_envs: environments in a batch.
        window: how many of the last finished episodes count (100 in the paper's lineage).
    """

    def __init__(self, num_envs: int, window: int = 100) -> None:
        self.running = torch.zeros(num_envs, dtype=torch.int64)
        self.last: deque[int] = deque(maxlen=window)

    def add(self, done: Tensor) -> Tensor:
        """Take in a batch; return how many control steps after its reset each step ended, from 1.

        Args:
            done: [num_envs, num_steps] bool, true at an episode's last step.

        Returns:
            [num_envs, num_steps] int64, on the CPU.
        """
        ages = []
        for done_now in done.cpu().unbind(dim=1):
            self.running += 1
            ages.append(self.running.clone())
            self.last.extend(self.running[done_now].tolist())
            self.running[done_now] = 0
        return torch.stack(ages, dim=1)

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


def mean_at_equal_ages(error: Tensor, age: Tensor) -> float:
    """Mean over the first two seconds after a reset, each half second counting alike.

    A robot that was reset a moment ago is near its reference, however bad the policy, so a plain
    mean is smaller where episodes are short. This is direct standardisation with equal weights for
    the steps of ``AGE_BANDS``; NaN where no robot got as far as the last of them.

    Args:
        error: [num_envs, num_steps], in any unit, which is that of the mean.
        age: control steps since the reset, from 1, as ``EpisodeLengths.add`` returns it.
    """
    return sum(error[(low < age) & (age <= high)].mean().item() for low, high in AGE_BANDS) / len(
        AGE_BANDS
    )


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
