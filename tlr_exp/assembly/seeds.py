"""The random streams of a run, one for each part that draws."""

from dataclasses import dataclass, fields

import numpy as np


@dataclass(frozen=True)
class Seeds:
    """Independent random streams of one run, all from its seed."""

    env: int
    networks: int
    exploration: int
    minibatches: int
    weights: int
    noise: int
    disturbance: int

    @classmethod
    def of(cls, seed: int) -> "Seeds":
        # 63 bits: the largest seed that both torch and NumPy take.
        # A further stream, at the end, leaves the numbers of those before it as they were.
        count = len(fields(cls))
        states = np.random.SeedSequence(seed).generate_state(count, np.uint64) >> np.uint64(1)
        return cls(*(int(state) for state in states))
