"""Differential evolution (Storn and Price 1997)."""

from collections.abc import Callable
from typing import Any, Literal, get_args

import torch
from torch import Tensor

from tlr_exp.objective import WeightFunction
from tlr_exp.optimizers.base import SearchResult, check_choice, check_number
from tlr_exp.optimizers.pack import PackOptimizer, Tally, TieBreak, first_pack, improves

Strategy = Literal["rand1bin", "best1bin"]
MIN_PACK_SIZE = 4  # a target and three others


def differential_evolution_search(
    objective_fn: Callable[[Tensor], Tensor],
    lower: Tensor,
    upper: Tensor,
    pack_size: int,
    iterations: int,
    generator: torch.Generator,
    tie_break: TieBreak = "first",
    start: Tensor | None = None,
    strategy: Strategy = "rand1bin",
    scale: float = 0.5,
    crossover: float = 0.9,
) -> SearchResult:
    """Minimise a function over a box by DE/rand/1/bin or DE/best/1/bin.

    Every member x_i of the population meets the mutant x_r1 + scale (x_r2 - x_r3), with r1, r2, r3
    and i all different (for best1bin the population's best takes the place of x_r1). The trial
    takes each component from the mutant with probability `crossover`, and one, drawn at random,
    for certain; then it is clipped to the box, so that weights 0 and 1 are found exactly. Storn
    and Price leave bounds open. The generation is evaluated at once.

    Ties: under `first` a trial replaces its target when it is not worse, as in the authors'
    program, so that the population can cross a plateau; the position returned is still the first
    of the best ones found. Under `largest_norm` among equals a smaller norm does not replace.

    Args:
        objective_fn: positions [pack, dims] -> values [pack].
        lower: lower bounds [dims]. Its device and dtype are those of the search.
        upper: upper bounds [dims].
        pack_size: size of the population, at least 4.
        iterations: number of generations after the first population.
        generator: source of all random numbers, on the device of `lower`.
        tie_break: see above.
        start: positions [n, dims] that replace the first n of the random population.
        strategy: `rand1bin` or `best1bin`.
        scale: F, factor of the difference.
        crossover: CR, probability of a component of the mutant.

    Returns:
        The best position found; `evaluations` is pack_size * (iterations + 1).

    Raises:
        ValueError: a value is not a number.
    """
    tally = Tally(objective_fn, lower, upper, tie_break)
    pack = first_pack(lower, upper, pack_size, generator, start)
    values = tally(pack)
    for _ in range(iterations):
        base, plus, minus = pack[_different(pack_size, generator).T]
        if strategy == "best1bin":
            base = tally.best
        taken = _crossing(pack, crossover, generator)
        trial = torch.where(taken, base + scale * (plus - minus), pack).clamp(lower, upper)
        trial_values = tally(trial)
        if tie_break == "first":
            accepted = trial_values <= values
        else:
            accepted = ~improves(pack, values, trial, trial_values, tie_break)
        pack = torch.where(accepted[:, None], trial, pack)
        values = torch.where(accepted, trial_values, values)
    return tally.result(pack, values)


class DifferentialEvolution(PackOptimizer):
    """Weights that minimise the objective, by differential evolution in every iteration.

    Args:
        strategy: what a difference is added to: `rand1bin`, a random member, or `best1bin`.
        scale: factor F of the difference, from 0 to 2.
        crossover: probability CR of a mutant's component, from 0 to 1.
        Others: see `PackOptimizer`.

    Raises:
        ValueError: a setting outside its range.
    """

    min_pack_size = MIN_PACK_SIZE
    why_min_pack_size = "a trial is made of its target and three others"

    def __init__(
        self,
        *arguments: Any,
        strategy: Strategy = "rand1bin",
        scale: float = 0.5,
        crossover: float = 0.9,
        **settings: Any,
    ) -> None:
        super().__init__(*arguments, **settings)
        check_choice("strategy", strategy, get_args(Strategy))
        check_number("scale", scale, 0.0, 2.0)
        check_number("crossover", crossover, 0.0, 1.0)
        self.strategy: Strategy = strategy
        self.scale = scale
        self.crossover = crossover

    def search(self, objective_fn: WeightFunction) -> SearchResult:
        """One differential evolution with the settings of this optimizer."""
        return differential_evolution_search(
            objective_fn,
            **self.search_settings(),
            strategy=self.strategy,
            scale=self.scale,
            crossover=self.crossover,
        )


def _different(pack_size: int, generator: torch.Generator) -> Tensor:
    """For each member three others, all different [pack_size, 3]."""
    keys = torch.rand((pack_size, pack_size), generator=generator, device=generator.device)
    return keys.fill_diagonal_(2.0).argsort(dim=1)[:, :3]


def _crossing(pack: Tensor, crossover: float, generator: torch.Generator) -> Tensor:
    """Which components come from the mutant [pack, dims] bool; at least one in each row."""
    draw = torch.rand(pack.shape, generator=generator, device=pack.device)
    for_certain = torch.randint(
        pack.shape[1], (len(pack), 1), generator=generator, device=pack.device
    )
    return (draw < crossover).scatter(1, for_certain, True)
