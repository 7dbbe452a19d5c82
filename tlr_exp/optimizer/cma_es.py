"""Covariance matrix adaptation (Hansen's CMA-ES), by the library cmaes."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
import torch
from cmaes import CMA, SepCMA
from numpy.typing import NDArray
from torch import Tensor

from tlr_exp.config.checks import check_at_least, check_within
from tlr_exp.optimizer.base import ChosenWeights
from tlr_exp.optimizer.search import SearchResult, SearchTask, Tally, TieBreak, best_first
from tlr_exp.reward.objectives import WeightFunction

_NUM_SEEDS = 2**32  # what NumPy's RandomState takes


def cma_search(
    objective_fn: Callable[[Tensor], Tensor],
    task: SearchTask,
    *,
    pack_size: int,
    iterations: int,
    initial_std: float,
    separable: bool,
    resampling: int,
) -> SearchResult:
    """Minimise a function over a box.

    The search runs in the unit cube. The mean starts at a uniform position, the standard deviation
    at `initial_std` (0.3 of the box is Hansen's advice). A sample outside the cube is drawn anew
    up to `resampling` times by the library, then clipped; with the minimum in a corner nearly
    every draw lies outside, so a large number only costs time. When the library says that the
    distribution has converged or that all values are the same, it starts anew from another
    uniform mean with what is left of the generations.

    The library's random numbers come from a generator of its own, made anew at every start from a
    seed that `generator` draws. So the state of `generator` is all that a continuation needs.

    Args:
        objective_fn: positions [pack, dims] -> values [pack].
        task: its tie-break is the order in which equally good samples are ranked; `start` [1, dims]
            is the first mean instead of a uniform one. The distribution itself is float64 on the
            CPU, whatever the box.
        pack_size: samples of a generation, at least 4.
        iterations: generations after the first.
        initial_std: standard deviation at a start, share of the box.
        separable: adapt the diagonal alone (sep-CMA-ES, Ros and Hansen 2008), for many dimensions.
        resampling: see above.

    Raises:
        ValueError: a value is not a number.
    """
    tally = Tally(objective_fn, task)
    lower, width, start = task.lower, task.upper - task.lower, task.start
    mean = None if start is None else ((start[0] - lower) / width).cpu().double().numpy()
    # One weight has no covariance to leave out, and the library refuses it.
    begin = partial(
        SepCMA if separable and len(lower) > 1 else CMA,
        sigma=initial_std,
        bounds=np.tile([0.0, 1.0], (len(lower), 1)),
        n_max_resampling=resampling,
        population_size=pack_size,
    )
    distribution = None
    pack, values = lower[None], lower[:1]
    for _ in range(iterations + 1):
        if distribution is None or distribution.should_stop():
            seed, uniform = _draw(lower, task.generator)
            distribution = begin(mean=uniform if mean is None else mean, seed=seed)
            mean = None
        samples = np.stack([distribution.ask() for _ in range(pack_size)])
        pack = (lower + width * torch.from_numpy(samples).to(lower)).clamp(lower, task.upper)
        values = tally(pack)
        order = best_first(pack, values, task.tie_break).tolist()
        distribution.tell([(samples[i], values[i].item()) for i in order])
    return tally.result(pack, values)


@dataclass(kw_only=True, eq=False)
class CmaEs(ChosenWeights):
    """Weights that minimise the objective, by CMA-ES in every iteration.

    Attributes:
        pack_size: samples of a generation, at least 4: half of them make the new mean.
        iterations: generations after the first per training iteration, at least 1.
        tie_break: in which order equally good weights are ranked.
        warm_start: the mean starts at the last iteration's weights.
        initial_std: standard deviation at a start, share of the box, above 0, at most 1.
        separable: adapt the diagonal of the covariance alone.
        resampling: how often a sample outside the box is drawn anew before it is clipped.
    """

    pack_size: int
    iterations: int
    lower: float
    upper: float
    tie_break: TieBreak
    warm_start: bool
    initial_std: float
    separable: bool
    resampling: int

    def __post_init__(self) -> None:
        super().__post_init__()
        self.set_box(self.lower, self.upper, self.tie_break)
        check_at_least("pack_size", self.pack_size, 4)
        check_at_least("iterations", self.iterations, 1)
        check_within("initial_std", self.initial_std, 1e-6, 1.0)
        check_at_least("resampling", self.resampling, 1)

    def search(self, objective_fn: WeightFunction) -> SearchResult:
        """One search by CMA-ES."""
        return cma_search(
            objective_fn,
            self.warm_task(self.warm_start),
            pack_size=self.pack_size,
            iterations=self.iterations,
            initial_std=self.initial_std,
            separable=self.separable,
            resampling=self.resampling,
        )


def _draw(lower: Tensor, generator: torch.Generator) -> tuple[int, NDArray[np.float64]]:
    """A seed for the library and a uniform mean in the unit cube [dims]."""
    device = generator.device
    seed = torch.randint(_NUM_SEEDS, (1,), generator=generator, device=device).item()
    mean = torch.rand(len(lower), generator=generator, device=device, dtype=torch.float64)
    return int(seed), mean.cpu().numpy()
