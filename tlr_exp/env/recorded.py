"""The reward terms that an environment records, in their order."""

from collections.abc import Mapping, Sequence
from functools import partial

import torch
from torch import Tensor

from tlr_exp.env.instant import Instant
from tlr_exp.env.terms import TERMS
from tlr_exp.env.transition import JointLimits, Transition


class RecordedTerms:
    """Raw terms of every step, and of every state those that are functions of the state.

    Args:
        terms: names of the reward terms and the constants that each takes.
        of_state: names of the terms whose values in the state in which a step begins are told, too.
        limits: of joints and motors.

    Attributes:
        names: the names of all terms, in order.
        of_state: as given.
    """

    def __init__(
        self,
        terms: Mapping[str, Mapping[str, float]],
        of_state: Sequence[str],
        limits: JointLimits,
    ) -> None:
        self.names, self.of_state, self.limits = tuple(terms), tuple(of_state), limits
        self._functions = [
            partial(TERMS[name].function, **constants) for name, constants in terms.items()
        ]
        self._columns = [self.names.index(name) for name in of_state]

    def of_step(self, step: Transition) -> Tensor:
        """All terms of a step [num_envs, num_terms]."""
        return torch.stack([function(step) for function in self._functions], dim=-1)

    def after(self, terms: Tensor) -> Tensor:
        """Those of the state in which a step has ended [num_envs, n], from its `terms`."""
        return terms[:, self._columns] if self._columns else terms[:, :0]

    def at_start(self, instant: Instant, no_action: Tensor) -> Tensor:
        """Those of states in which episodes start [num_envs, n]; actions are none of theirs."""
        alive = torch.zeros(len(no_action), dtype=torch.bool, device=no_action.device)
        start = Transition(instant, no_action, no_action, alive, self.limits)
        values = [self._functions[column](start) for column in self._columns]
        return torch.stack(values, dim=-1)
