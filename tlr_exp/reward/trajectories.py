"""What a trajectory is that the search ranks: readings of a word that the paper leaves open.

A reading turns the raw terms of one iteration into raw terms whose sums over the steps are those of
the trajectories, one for each environment. The reward that is learned from stays that of the steps.
"""

from dataclasses import dataclass
from typing import Any, Protocol

import torch
from torch import Tensor

# Steps are comparable in the same eighth of the motion and in the same band of ages. The bands are
# narrow where a robot has just been put on its reference, because there a step tells most.
PHASE_BINS = 8
LAST_AGES = (6, 12, 25, 50, 100)  # of each band but the last, control steps since the reset


@dataclass(frozen=True)
class Steps:
    """The steps of one iteration.

    Attributes:
        terms: raw values [num_envs, num_steps, num_terms].
        done: whether a step ended its episode [num_envs, num_steps] bool.
        age: control steps since the reset, from 1 [num_envs, num_steps] int64.
        phase: of the motion, from 0 to 1 [num_envs, num_steps].
    """

    terms: Tensor
    done: Tensor
    age: Tensor
    phase: Tensor


class Trajectories(Protocol):
    """A reading: called once for every iteration, in order."""

    def __call__(self, steps: Steps) -> Tensor:
        """Raw terms [num_envs, n, num_terms] whose sums over n are those of the trajectories."""
        ...

    def state_dict(self) -> dict[str, Any]:
        """What the next call depends on besides its argument (tensors)."""
        ...

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Continue, bit for bit, from where `state_dict` was taken."""
        ...


class Segments:
    """All steps of the iteration, whatever episodes they belong to."""

    def __call__(self, steps: Steps) -> Tensor:
        """The terms as they are."""
        return steps.terms

    def state_dict(self) -> dict[str, Any]:
        """Nothing."""
        return {}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Nothing to continue from."""


class AgeMatched(Segments):
    """The steps of the iteration, each compared with its like.

    From each term of a step the mean over all steps of the iteration at about the same phase of the
    motion and the same time since the reset is subtracted. What is left says how much better a
    robot did than others in its place, so that a segment does not rank high merely because it has
    just begun on the reference. This is direct subtraction of cell means; being linear in the
    terms, it is the same for r_t at any weights.
    """

    def __call__(self, steps: Steps) -> Tensor:
        """Terms minus the means of their cells; a step alone in its cell is left with 0."""
        phase = (steps.phase * PHASE_BINS).long().clamp(0, PHASE_BINS - 1)
        bounds = torch.tensor(LAST_AGES, device=phase.device)
        age = torch.bucketize(steps.age.to(phase.device), bounds)
        cell = (phase * (len(LAST_AGES) + 1) + age).flatten()
        terms = steps.terms.flatten(0, 1).double()
        num_cells = PHASE_BINS * (len(LAST_AGES) + 1)
        sums = terms.new_zeros(num_cells, terms.shape[1]).index_add(0, cell, terms)
        counts = torch.bincount(cell, minlength=num_cells).clamp(min=1)
        means = sums / counts[:, None]
        return (terms - means[cell]).to(steps.terms).reshape(steps.terms.shape)


class Episodes:
    """The episode that runs as an iteration begins: from its reset to its end, or the iteration's.

    What an episode has brought in earlier iterations counts. An episode that begins and ends within
    one iteration is part of no trajectory.

    Args:
        per_step: the mean over the steps of the episode instead of their sum.

    Attributes:
        earlier: sums of the running episodes' terms over earlier iterations [num_envs, num_terms].
    """

    def __init__(self, per_step: bool) -> None:
        self.per_step = per_step
        self.earlier = torch.zeros(1, 1)

    def __call__(self, steps: Steps) -> Tensor:
        """Sums, or means, of the episodes [num_envs, 1, num_terms]."""
        ends = steps.done.long()
        of_running = (ends.cumsum(dim=1) - ends) == 0  # no earlier step ended an episode
        earlier = self.earlier.to(steps.terms)
        total = earlier + _sum_where(of_running, steps.terms)
        if self.per_step:
            count = steps.age[:, 0].to(ends.device) - 1 + of_running.sum(dim=1)
            total = total / count[:, None]
        of_next = ends.flip(1).cumsum(dim=1).flip(1) == 0  # neither this nor a later step ended one
        kept = torch.where(steps.done.any(dim=1, keepdim=True), 0.0, earlier)
        self.earlier = kept + _sum_where(of_next, steps.terms)
        return total[:, None]

    def state_dict(self) -> dict[str, Any]:
        """The sums over earlier iterations."""
        return {"earlier": self.earlier.clone()}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Continue with these sums."""
        self.earlier = state["earlier"].clone()


def trajectories_of(reading: str) -> Trajectories:
    """A reading by its word, the key `reward.ranked`."""
    readings: dict[str, Trajectories] = {
        "segment": Segments(),
        "episode": Episodes(per_step=False),
        "per_step": Episodes(per_step=True),
        "age_matched": AgeMatched(),
    }
    return readings[reading]


def _sum_where(mask: Tensor, terms: Tensor) -> Tensor:
    """Sum over the steps where `mask` [num_envs, num_steps] is true [num_envs, num_terms]."""
    return torch.where(mask[..., None], terms, 0.0).sum(dim=1)
