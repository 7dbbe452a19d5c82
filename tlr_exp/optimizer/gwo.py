"""The Grey Wolf Optimizer (Mirjalili, Mirjalili and Lewis 2014), the paper's Algorithm 1."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import torch
from torch import Tensor

from tlr_exp.config.checks import check_at_least
from tlr_exp.errors import UserError
from tlr_exp.optimizer.base import ChosenWeights
from tlr_exp.optimizer.search import SearchResult, SearchTask, Tally, TieBreak, best_first
from tlr_exp.reward.objectives import WeightFunction

NUM_LEADERS = 3  # alpha, beta and delta


def grey_wolf_search(
    objective_fn: Callable[[Tensor], Tensor], task: SearchTask, *, pack_size: int, iterations: int
) -> SearchResult:
    """Minimise a function over a box.

    In iteration t of T every wolf X moves, in every dimension, to the mean over the three
    leaders X_k of X_k - A |C X_k - X|, with A = a (2 r1 - 1), C = 2 r2, a = 2 - 2 t / T, and
    r1, r2 ~ U(0, 1) fresh for each wolf, dimension and leader; then it is clipped to the box.
    The leaders are the best three positions seen so far.

    The leaders come from a stable sort of the old leaders followed by the pack. With the strict
    inequalities and the leaders at the origin of the textbook's program, a function with
    plateaus leaves two leaders at the origin and drags the pack towards it.

    Args:
        objective_fn: positions [pack, dims] -> values [pack].
        task: its tie-break says which of equally good positions leads; the first wolves stand at
            `start`.
        pack_size: wolves, at least 3.
        iterations: moves of the pack, which is evaluated at first and after each.

    Raises:
        ValueError: a value is not a number.
    """
    tally = Tally(objective_fn, task)
    pack = task.first_pack(pack_size)
    values = tally(pack)
    leaders, leader_values = _leaders(pack, values, task.tie_break)
    for iteration in range(iterations):
        reach = 2.0 - 2.0 * iteration / iterations
        pack = _move(pack, leaders, reach, task.generator).clamp(task.lower, task.upper)
        values = tally(pack)
        leaders, leader_values = _leaders(
            torch.cat([leaders, pack]), torch.cat([leader_values, values]), task.tie_break
        )
    return tally.result(pack, values)


@dataclass(kw_only=True, eq=False)
class GreyWolfOptimizer(ChosenWeights):
    """Weights that minimise the objective, by a grey wolf search in every iteration.

    Attributes:
        pack_size: wolves, at least 3.
        iterations: moves of the pack per training iteration, at least 1.
        persistent: the pack lives on: a search starts with the wolves where the last one left
            them, the first of them at the weights it found. J is evaluated anew, as the
            trajectories are others. At the end of a search the wolves stand close together; the
            wide moves that the next one begins with spread them again.
    """

    pack_size: int
    iterations: int
    lower: float
    upper: float
    tie_break: TieBreak
    warm_start: bool
    persistent: bool = False  # runs of the first version do not say it

    def __post_init__(self) -> None:
        super().__post_init__()
        self.set_box(self.lower, self.upper, self.tie_break)
        check_at_least("pack_size", self.pack_size, NUM_LEADERS)
        check_at_least("iterations", self.iterations, 1)
        if self.persistent:
            self.pack = self.task.lower.new_empty(0, self.num_terms)  # none before the first search
            self.saved = (*self.saved, "pack")

    def search(self, objective_fn: WeightFunction) -> SearchResult:
        """One grey wolf search; the pack that it leaves is kept if it is to live on."""
        task = self.warm_task(self.warm_start)
        if self.persistent and len(self.pack):
            task = replace(task, start=self.pack)
        result = grey_wolf_search(
            objective_fn, task, pack_size=self.pack_size, iterations=self.iterations
        )
        if self.persistent:
            self.pack = torch.cat([result.position[None], result.pack[1:]])
        return result

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Continue, bit for bit, from where `state_dict` was taken.

        Raises:
            UserError: see `ChosenWeights.load_state_dict`; or a pack of another size.
        """
        if self.persistent and "pack" in state and len(state["pack"]) not in (0, self.pack_size):
            raise UserError(
                f"the saved pack has shape {tuple(state['pack'].shape)}, this optimizer's is "
                f"({self.pack_size}, {self.num_terms}): resume with the settings it was saved with"
            )
        super().load_state_dict(state)


def _move(pack: Tensor, leaders: Tensor, reach: float, generator: torch.Generator) -> Tensor:
    """New positions [pack, dims], not yet clipped; `reach` is a of `grey_wolf_search`."""
    shape = (2, len(leaders), *pack.shape)
    r1, r2 = torch.rand(shape, generator=generator, device=pack.device, dtype=pack.dtype)
    leader = leaders[:, None, :]
    distance = (2.0 * r2 * leader - pack).abs()
    return (leader - reach * (2.0 * r1 - 1.0) * distance).mean(dim=0)


def _leaders(positions: Tensor, values: Tensor, tie_break: TieBreak) -> tuple[Tensor, Tensor]:
    """The best three positions [3, dims] and their values [3]; earlier rows win ties."""
    best = best_first(positions, values, tie_break)[:NUM_LEADERS]
    return positions[best], values[best]
