"""Differential evolution (Storn and Price 1997)."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, get_args

import torch
from torch import Tensor

from tlr_exp.config.checks import check_at_least, check_choice, check_within
from tlr_exp.optimizer.base import ChosenWeights
from tlr_exp.optimizer.search import SearchResult, SearchTask, Tally, TieBreak, improves
from tlr_exp.reward.objectives import WeightFunction

Strategy = Literal["rand1bin", "best1bin"]
MIN_PACK_SIZE = 4  # a target and three others


def differential_evolution_search(
    objective_fn: Callable[[Tensor], Tensor],
    task: SearchTask,
    *,
    pack_size: int,
    iterations: int,
    strategy: Strategy,
    scale: float,
    crossover: float,
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
        task: for its tie-break see above; the first members begin at `start`.
        pack_size: members of the population, at least 4.
        iterations: generations after the first.
        strategy: `rand1bin` or `best1bin`.
        scale: F, factor of the difference.
        crossover: CR, probability of a component of the mutant.

    Raises:
        ValueError: a value is not a number.
    """
    tally = Tally(objective_fn, task)
    pack = task.first_pack(pack_size)
    values = tally(pack)
    for _ in range(iterations):
        base, plus, minus = pack[_different(len(pack), task.generator).T]
        if strategy == "best1bin":
            base = tally.best
        taken = _crossing(pack, crossover, task.generator)
        trial = torch.where(taken, base + scale * (plus - minus), pack)
        trial = trial.clamp(task.lower, task.upper)
        trial_values = tally(trial)
        if task.tie_break == "first":
            accepted = trial_values <= values
        else:
            accepted = ~improves(pack, values, trial, trial_values, task.tie_break)
        pack = torch.where(accepted[:, None], trial, pack)
        values = torch.where(accepted, trial_values, values)
    return tally.result(pack, values)


@dataclass(kw_only=True, eq=False)
class DifferentialEvolution(ChosenWeights):
    """Weights that minimise the objective, by differential evolution in every iteration.

    Attributes:
        pack_size: members of the population, at least 4.
        iterations: generations per training iteration, at least 1.
        strategy: what a difference is added to: `rand1bin`, a random member, or `best1bin`.
        scale: factor F of the difference, from 0 to 2.
        crossover: probability CR of a mutant's component, from 0 to 1.
    """

    pack_size: int
    iterations: int
    lower: float
    upper: float
    tie_break: TieBreak
    warm_start: bool
    strategy: Strategy
    scale: float
    crossover: float

    def __post_init__(self) -> None:
        super().__post_init__()
        self.set_box(self.lower, self.upper, self.tie_break)
        check_at_least("pack_size", self.pack_size, MIN_PACK_SIZE)
        check_at_least("iterations", self.iterations, 1)
        check_choice("strategy", self.strategy, get_args(Strategy))
        check_within("scale", self.scale, 0.0, 2.0)
        check_within("crossover", self.crossover, 0.0, 1.0)

    def search(self, objective_fn: WeightFunction) -> SearchResult:
        """One search by differential evolution."""
        return differential_evolution_search(
            objective_fn,
            self.warm_task(self.warm_start),
            pack_size=self.pack_size,
            iterations=self.iterations,
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
