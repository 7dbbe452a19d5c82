"""The shell shared by optimizers that pick weights from a box with random numbers of their own.

A new algorithm is a pure function that returns a `SearchResult`, and a small subclass of
`BoxOptimizer` that holds its settings.
"""

import math
from typing import Any

import torch
from torch import Tensor

from tlr_exp.optimizer.base import SearchOptimizer, check_integer, check_state_names
from tlr_exp.optimizer.protocol import WeightUpdate
from tlr_exp.reward.objectives import Objective


class BoxOptimizer(SearchOptimizer):
    """A `WeightOptimizer` that picks weights from [lower, upper]^num_terms.

    Args:
        num_terms: number of optimizing terms, at least 1.
        objective: the function to minimise, prepared anew in every iteration.
        seed: seed of this optimizer's own random generator.
        device: where the search runs. The tensors are small: on most machines "cpu" is best.
        lower: smallest weight.
        upper: largest weight.

    Raises:
        ValueError: a setting outside its range.
    """

    def __init__(
        self,
        num_terms: int,
        objective: Objective,
        seed: int,
        device: str | torch.device = "cpu",
        *,
        lower: float = 0.0,
        upper: float = 1.0,
    ) -> None:
        check_integer("num_terms", num_terms, 1, "the reward has no optimizing terms to weigh")
        check_integer("seed", seed, 0)
        if not -math.inf < lower < upper < math.inf:
            raise ValueError(
                f"lower {lower!r} and upper {upper!r} must be finite with lower < upper "
                "(the paper: 0 and 1)"
            )
        super().__init__(num_terms, objective, device)
        self.lower = torch.full((num_terms,), float(lower), device=self.device)
        self.upper = torch.full((num_terms,), float(upper), device=self.device)
        self.generator = torch.Generator(self.device).manual_seed(seed)
        # Before the first iteration the reward is the static one: every weight 1.
        self.last_weights = torch.ones(num_terms, device=self.device).clamp(self.lower, self.upper)

    def update(self, goal_return: Tensor, term_returns: Tensor) -> WeightUpdate:
        """As `SearchOptimizer.update`; the weights are kept for a warm start of the next one."""
        update = super().update(goal_return, term_returns)
        self.last_weights = update.weights.to(self.device, copy=True)
        return update

    def state_dict(self) -> dict[str, Any]:
        """The generator's state (uint8, on the CPU) and the last weights [num_terms]."""
        return {
            "generator": self.generator.get_state(),
            "last_weights": self.last_weights.clone(),
        }

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Continue, bit for bit, from where `state_dict` was taken.

        Raises:
            ValueError: missing or unknown entries, or weights of another number of terms.
        """
        check_state_names(state, {"generator", "last_weights"})
        weights = state["last_weights"]
        if weights.shape != (self.num_terms,):
            raise ValueError(
                f"the saved optimizer has weights of shape {tuple(weights.shape)}, this one has "
                f"{self.num_terms} terms: resume with the reward terms it was saved with"
            )
        self.last_weights = weights.to(self.lower, copy=True)
        self.generator.set_state(state["generator"].cpu())


def uniform_positions(
    lower: Tensor, upper: Tensor, count: int, generator: torch.Generator
) -> Tensor:
    """Positions drawn uniformly from the box [count, dims]."""
    unit = torch.rand(
        (count, len(lower)), generator=generator, device=lower.device, dtype=lower.dtype
    )
    # Rounding could leave the box by the last bit.
    return (lower + (upper - lower) * unit).clamp(lower, upper)
