"""The Grey Wolf Optimizer (Mirjalili, Mirjalili and Lewis 2014), the paper's Algorithm 1."""

from collections.abc import Callable
from typing import Any

import torch
from torch import Tensor

from tlr_exp.optimizer.base import SearchResult, check_flag
from tlr_exp.optimizer.pack import PackOptimizer, PackSearch, TieBreak, best_first
from tlr_exp.reward.objectives import WeightFunction

NUM_LEADERS = 3  # alpha, beta and delta


def grey_wolf_search(objective_fn: Callable[[Tensor], Tensor], task: PackSearch) -> SearchResult:
    """Minimise a function over a box.

    In iteration t of T every wolf X moves, in every dimension, to the mean over the three
    leaders X_k of X_k - A |C X_k - X|, with A = a (2 r1 - 1), C = 2 r2, a = 2 - 2 t / T, and
    r1, r2 ~ U(0, 1) fresh for each wolf, dimension and leader; then it is clipped to the box.
    The leaders are the best three positions seen so far.

    The leaders come from a stable sort of the old leaders followed by the pack. With the strict
    inequalities and the leaders at the origin of the textbook's program, a function with
    plateaus leaves the leaders at the origin and drags the pack there.

    Args:
        objective_fn: positions [pack, dims] -> values [pack].
        task: the pack has at least 3 wolves; its tie-break says which of equally good positions
            leads.

    Raises:
        ValueError: a value is not a number.
    """
    tally = task.tally(objective_fn)
    pack = task.first_pack()
    values = tally(pack)
    leaders, leader_values = _leaders(pack, values, task.tie_break)
    for iteration in range(task.iterations):
        reach = 2.0 - 2.0 * iteration / task.iterations
        pack = _move(pack, leaders, reach, task.generator).clamp(task.lower, task.upper)
        values = tally(pack)
        leaders, leader_values = _leaders(
            torch.cat([leaders, pack]), torch.cat([leader_values, values]), task.tie_break
        )
    return tally.result(pack, values)


class GreyWolfOptimizer(PackOptimizer):
    """Weights that minimise the objective, by a grey wolf search in every iteration.

    Args:
        pack_size: number of wolves, at least 3.
        persistent: the pack lives on: a search starts with the wolves where the last one left
            them, the first of them at the weights it found. J is evaluated anew, as the
            trajectories are others. At the end of a search the wolves stand close together; the
            wide moves that the next one begins with spread them again.
        Others: see `PackOptimizer`.

    Raises:
        ValueError: a setting outside its range.
    """

    algorithm = staticmethod(grey_wolf_search)
    min_pack_size = NUM_LEADERS
    why_min_pack_size = "the pack follows its best three wolves"

    def __init__(
        self,
        *arguments: Any,
        persistent: bool = False,
        **settings: Any,
    ) -> None:
        super().__init__(*arguments, **settings)
        check_flag("persistent", persistent)
        self.persistent = persistent
        self.pack = self.lower.new_empty(0, self.num_terms)  # none before the first search

    def search(self, objective_fn: WeightFunction) -> SearchResult:
        """As `PackOptimizer.search`; the pack that it leaves is kept if it is to live on."""
        result = super().search(objective_fn)
        if self.persistent:
            self.pack = torch.cat([result.position[None], result.pack[1:]])
        return result

    def start(self) -> Tensor | None:
        """The last search's pack [pack_size, num_terms], or what a warm start begins with."""
        return self.pack if len(self.pack) else super().start()

    def state_dict(self) -> dict[str, Any]:
        """As `BoxOptimizer.state_dict`; with a persistent pack also that [pack_size, num_terms]."""
        pack = {"pack": self.pack.clone()} if self.persistent else {}
        return {**super().state_dict(), **pack}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Continue, bit for bit, from where `state_dict` was taken.

        Raises:
            ValueError: see `BoxOptimizer.load_state_dict`; or a pack of another size.
        """
        rest = dict(state)
        if self.persistent and "pack" in rest:
            pack = rest.pop("pack")
            if pack.shape not in [(0, self.num_terms), (self.pack_size, self.num_terms)]:
                raise ValueError(
                    f"the saved pack has shape {tuple(pack.shape)}, this optimizer's is "
                    f"({self.pack_size}, {self.num_terms}): resume with the settings it was "
                    "saved with"
                )
            self.pack = pack.to(self.lower, copy=True)
        super().load_state_dict(rest)


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
