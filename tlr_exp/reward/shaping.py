"""Costs as potentials: they guide the learning and leave the optimal policy as it is.

Ng, Harada and Russell, "Policy invariance under reward transformations" (1999): in place of a cost
k(s') the reward gets F = γ Φ(s') - Φ(s), where Φ is minus k times its coefficient. Along an episode
that fails the discounted sum of F telescopes to -Φ(s_0), whatever the policy does.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor


@dataclass(frozen=True)
class Shaping:
    """Which terms are potentials, and the discount with which their differences are taken.

    Attributes:
        names: of the terms, functions of the state alone; none where nothing is shaped.
        term_names: the recorded terms, in the order of the last axis of the raw values.
        gamma: the learner's discount.
    """

    names: Sequence[str]
    term_names: Sequence[str]
    gamma: float

    def __call__(self, terms: Tensor, before: Tensor, terminated: Tensor) -> Tensor:
        """Raw terms in which those that are potentials are differences, γ k(s') - k(s).

        At a failure, k(s') counts as 0. At the end of the motion it is that of the state in which
        the episode was cut off, and not that of the next one's start: the learner goes on from
        there with the critic's value.

        Args:
            terms: raw values, of the states in which the steps end [..., num_terms].
            before: the potentials' raw values in the states in which the steps begin [..., n], in
                the order of `names`.
            terminated: whether the step ended its episode by a failure [...] bool.
        """
        columns = [self.term_names.index(name) for name in self.names]
        follows = torch.where(terminated[..., None], 0.0, terms[..., columns])
        shaped = terms.clone()
        shaped[..., columns] = self.gamma * follows - before
        return shaped
