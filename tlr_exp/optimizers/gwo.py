"""The Grey Wolf Optimizer (Mirjalili, Mirjalili and Lewis 2014), the paper's Algorithm 1."""

from collections.abc import Callable
from typing import Literal, get_args

import torch
from torch import Tensor

from tlr_exp.objective import Objective, WeightFunction
from tlr_exp.optimizers.base import SearchResult, check_integer
from tlr_exp.optimizers.box import BoxOptimizer, uniform_positions

TieBreak = Literal["first", "largest_norm"]
NUM_LEADERS = 3  # alpha, beta and delta


def grey_wolf_search(
    objective_fn: Callable[[Tensor], Tensor],
    lower: Tensor,
    upper: Tensor,
    pack_size: int,
    iterations: int,
    generator: torch.Generator,
    tie_break: TieBreak = "first",
    start: Tensor | None = None,
) -> SearchResult:
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
        lower: lower bounds [dims]. Its device and dtype are those of the search.
        upper: upper bounds [dims].
        pack_size: number of wolves, at least 3.
        iterations: number of moves T, at least 1.
        generator: source of all random numbers, on the device of `lower`.
        tie_break: which of equally good positions leads. `first`: the one found first.
            `largest_norm`: the one with the largest Euclidean norm, and of these the first.
        start: positions [n, dims] that replace the first n of the random pack.

    Returns:
        The best position found; `evaluations` is pack_size * (iterations + 1).

    Raises:
        ValueError: a setting outside its range, or a value that is not a number.
    """
    check_search_settings(pack_size, iterations, tie_break)
    pack = uniform_positions(lower, upper, pack_size, generator)
    if start is not None:
        pack[: len(start)] = start.to(pack).clamp(lower, upper)
    values = _evaluate(objective_fn, pack)
    leaders, leader_values = _leaders(pack, values, tie_break)
    best_values = [leader_values[0]]
    for iteration in range(iterations):
        reach = 2.0 - 2.0 * iteration / iterations
        pack = _move(pack, leaders, reach, generator).clamp(lower, upper)
        values = _evaluate(objective_fn, pack)
        leaders, leader_values = _leaders(
            torch.cat([leaders, pack]), torch.cat([leader_values, values]), tie_break
        )
        best_values.append(leader_values[0])
    return SearchResult(
        position=leaders[0].clone(),
        value=leader_values[0].item(),
        pack_values=values,
        best_values=torch.stack(best_values),
        evaluations=pack_size * (iterations + 1),
    )


class GreyWolfOptimizer(BoxOptimizer):
    """Weights that minimise the objective, by a grey wolf search in every iteration.

    Args:
        num_terms, objective, seed, device, lower, upper: see `BoxOptimizer`.
        pack_size: number of wolves, at least 3.
        iterations: number of moves of the pack per training iteration, at least 1.
        tie_break: which of equally good weights lead, see `grey_wolf_search`.
        warm_start: the first wolf starts at the last iteration's weights; in the first iteration
            at weights 1, clipped to the box.

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
        pack_size: int = 30,
        iterations: int = 50,
        tie_break: TieBreak = "first",
        warm_start: bool = False,
    ) -> None:
        super().__init__(num_terms, objective, seed, device, lower=lower, upper=upper)
        check_search_settings(pack_size, iterations, tie_break)
        if not isinstance(warm_start, bool):
            raise ValueError(f"warm_start must be true or false, got {warm_start!r}")
        self.pack_size = pack_size
        self.iterations = iterations
        self.tie_break: TieBreak = tie_break
        self.warm_start = warm_start

    def search(self, objective_fn: WeightFunction) -> SearchResult:
        """One grey wolf search with the settings of this optimizer."""
        return grey_wolf_search(
            objective_fn,
            self.lower,
            self.upper,
            pack_size=self.pack_size,
            iterations=self.iterations,
            generator=self.generator,
            tie_break=self.tie_break,
            start=self.last_weights[None] if self.warm_start else None,
        )


def check_search_settings(pack_size: int, iterations: int, tie_break: str) -> None:
    """Refuse settings with which no search can run.

    Raises:
        ValueError: names the setting and its allowed values.
    """
    check_integer("pack_size", pack_size, NUM_LEADERS, "the pack follows its best three wolves")
    check_integer("iterations", iterations, 1)
    if tie_break not in get_args(TieBreak):
        raise ValueError(f"tie_break must be one of {list(get_args(TieBreak))}, got {tie_break!r}")


def _move(pack: Tensor, leaders: Tensor, reach: float, generator: torch.Generator) -> Tensor:
    """New positions [pack, dims], not yet clipped; `reach` is a of `grey_wolf_search`."""
    shape = (2, len(leaders), *pack.shape)
    r1, r2 = torch.rand(shape, generator=generator, device=pack.device, dtype=pack.dtype)
    leader = leaders[:, None, :]
    distance = (2.0 * r2 * leader - pack).abs()
    return (leader - reach * (2.0 * r1 - 1.0) * distance).mean(dim=0)


def _leaders(positions: Tensor, values: Tensor, tie_break: TieBreak) -> tuple[Tensor, Tensor]:
    """The best three positions [3, dims] and their values [3]; earlier rows win ties."""
    if tie_break == "largest_norm":
        by_norm = positions.norm(dim=1).argsort(descending=True, stable=True)
        positions, values = positions[by_norm], values[by_norm]
    best = values.argsort(stable=True)[:NUM_LEADERS]
    return positions[best], values[best]


def _evaluate(objective_fn: Callable[[Tensor], Tensor], pack: Tensor) -> Tensor:
    """Values [pack]. A value that is not a number would lead or hide the pack: it is refused."""
    values = objective_fn(pack)
    if values.isnan().any():
        bad = pack[values.isnan()][0].tolist()
        raise ValueError(f"the objective is not a number at the weights {bad}")
    return values
