"""The reward terms that an environment records, in their order."""

from collections.abc import Mapping, Sequence
from functools import partial

import torch
from torch import Tensor

from tlr_exp.env.instant import Instant
from tlr_exp.env.temperatures import Temperatures
from tlr_exp.env.terms import TERMS
from tlr_exp.env.transition import JointLimits, Transition


class RecordedTerms:
    """Raw terms of every step, and of every state those that are functions of the state.

    Args:
        terms: names of the reward terms and the constants that each takes.
        of_state: names of the terms whose values in the state in which a step begins are told, too.
        limits: of joints and motors; its device is that of the terms.
        sigma_rate: of the moving averages that the sigmas of tracking terms follow (see
            ``temperatures.py``); None where they stay.

    Attributes:
        names: the names of all terms, in order.
        of_state: as given.
        temperatures: the sigmas that adapt; of no term where they stay.
    """

    def __init__(
        self,
        terms: Mapping[str, Mapping[str, float]],
        of_state: Sequence[str],
        limits: JointLimits,
        sigma_rate: float | None = None,
    ) -> None:
        self.names, self.of_state, self.limits = tuple(terms), tuple(of_state), limits
        self._functions = [
            partial(TERMS[name].function, **constants) for name, constants in terms.items()
        ]
        self._columns = [self.names.index(name) for name in of_state]
        sigmas = {name: constants["sigma"] for name, constants in terms.items() if _adapts(name)}
        adaptive = {} if sigma_rate is None else sigmas
        device = limits.effort_nm.device
        self.temperatures = Temperatures(adaptive, sigma_rate or 0.0, device)
        self._adaptive = [self.names.index(name) for name in adaptive]

    def of_step(self, step: Transition) -> Tensor:
        """All terms of a step [num_envs, num_terms]; sigmas that adapt then take them in."""
        now = self.temperatures.constants()
        values = [
            function(step, **now.get(name, {}))
            for name, function in zip(self.names, self._functions, strict=True)
        ]
        terms = torch.stack(values, dim=-1)
        if self._adaptive:
            first = [self._functions[column](step) for column in self._adaptive]
            self.temperatures.update(torch.stack(first, dim=-1))
        return terms

    def sigmas(self) -> dict[str, float]:
        """The sigmas that adapt, as they are now, by the names of their terms."""
        return dict(zip(self.temperatures.names, self.temperatures.sigma.tolist(), strict=True))

    def after(self, terms: Tensor) -> Tensor:
        """Those of the state in which a step has ended [num_envs, n], from its `terms`."""
        return terms[:, self._columns] if self._columns else terms[:, :0]

    def at_start(self, instant: Instant, no_action: Tensor) -> Tensor:
        """Those of states in which episodes start [num_envs, n]; actions are none of theirs."""
        alive = torch.zeros(len(no_action), dtype=torch.bool, device=no_action.device)
        start = Transition(instant, no_action, no_action, alive, self.limits)
        values = [self._functions[column](start) for column in self._columns]
        return torch.stack(values, dim=-1)

    def state_dict(self) -> dict[str, Tensor]:
        """The sigmas that adapt, if there are any."""
        return self.temperatures.state_dict() if self._adaptive else {}

    def load_state_dict(self, state: Mapping[str, Tensor]) -> None:
        if self._adaptive:
            self.temperatures.load_state_dict(state)


def _adapts(name: str) -> bool:
    """Whether a term is of the form exp(-e/sigma)."""
    return not TERMS[name].is_cost and "sigma" in TERMS[name].constants
