"""An optimizer around another one: what it passes on, and what is saved of both."""

from abc import abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

from torch import Tensor

from tlr_exp.optimizer.base import ChosenWeights
from tlr_exp.optimizer.protocol import TrainingProgress, WeightOptimizer, WeightUpdate
from tlr_exp.optimizer.search import SearchResult, unsearched
from tlr_exp.reward.objectives import WeightFunction


@dataclass(kw_only=True, eq=False)
class Around(ChosenWeights):
    """A `ChosenWeights` that makes another optimizer, which hears and is saved with it.

    Attributes:
        inner: makes the optimizer inside from num_terms, objective, seed and device.
        parts: the optimizers that were made, by the name of their setting; a subclass may add some.
    """

    inner: Callable[..., WeightOptimizer]

    def __post_init__(self) -> None:
        super().__post_init__()
        self.parts: dict[str, WeightOptimizer] = {"inner": self.made(self.inner)}

    def made(self, make: Callable[..., WeightOptimizer]) -> WeightOptimizer:
        """An optimizer with this one's number of terms, objective, seed and device."""
        return make(
            num_terms=self.num_terms, objective=self.objective, seed=self.seed, device=self.device
        )

    def observe(self, progress: TrainingProgress) -> None:
        """Let the parts learn how the training goes."""
        for part in self.parts.values():
            part.observe(progress)

    def state_dict(self) -> dict[str, Any]:
        """What this optimizer saves itself, and the states of the parts: `inner.NAME`."""
        of_parts = {
            f"{part}.{name}": value
            for part, optimizer in self.parts.items()
            for name, value in optimizer.state_dict().items()
        }
        return {**super().state_dict(), **of_parts}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Continue, bit for bit, from where `state_dict` was taken.

        Raises:
            UserError: the state of another kind of optimizer.
        """
        own = {name: value for name, value in state.items() if _part_of(name) not in self.parts}
        super().load_state_dict(own)
        for part, optimizer in self.parts.items():
            saved = {name: value for name, value in state.items() if _part_of(name) == part}
            optimizer.load_state_dict(
                {name.removeprefix(f"{part}."): value for name, value in saved.items()}
            )


def _part_of(name: str) -> str:
    """The part that a saved entry belongs to; an entry of the optimizer itself has no dot."""
    return name.partition(".")[0]


@dataclass(kw_only=True, eq=False)
class Reweighted(Around):
    """Makes its weights from those of the optimizer inside; J is recorded at what they become."""

    @abstractmethod
    def changed(self, weights: Tensor) -> Tensor:
        """The weights to use in place of those that `inner` has chosen [num_terms]."""

    def update(self, goal_return: Tensor, term_returns: Tensor) -> WeightUpdate:
        """The changed weights; evaluations, the optimal share and details are those of `inner`."""
        found = self.parts["inner"].update(goal_return, term_returns)
        self._weights = self.changed(found.weights.to(self.device))
        ours = super().update(goal_return, term_returns)
        kept = {name: getattr(found, name) for name in ("evaluations", "optimal_share", "details")}
        return replace(ours, **kept)

    def search(self, objective_fn: WeightFunction) -> SearchResult:
        """The changed weights, whatever their J."""
        return unsearched(self._weights.clone(), objective_fn)
