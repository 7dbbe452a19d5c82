"""Covariance matrix adaptation (Hansen's CMA-ES), by the library cmaes."""

from collections.abc import Callable
from typing import Any

import numpy as np
import torch
from cmaes import CMA, SepCMA
from numpy.typing import NDArray
from torch import Tensor

from tlr_exp.objective import WeightFunction
from tlr_exp.optimizers.base import SearchResult, check_flag, check_integer, check_number
from tlr_exp.optimizers.pack import PackOptimizer, Tally, TieBreak, best_first

_NUM_SEEDS = 2**32  # what NumPy's RandomState takes


def cma_search(
    objective_fn: Callable[[Tensor], Tensor],
    lower: Tensor,
    upper: Tensor,
    pack_size: int,
    iterations: int,
    generator: torch.Generator,
    tie_break: TieBreak = "first",
    start: Tensor | None = None,
    initial_std: float = 0.3,
    separable: bool = False,
    resampling: int = 5,
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
        lower: lower bounds [dims]. Its device and dtype are those at which positions are valued;
            the distribution itself is float64 on the CPU.
        upper: upper bounds [dims].
        pack_size: samples of a generation, at least 4.
        iterations: number of generations after the first.
        generator: source of the seeds and of the first means, on the device of `lower`.
        tie_break: in which order equally good samples are ranked, see `pack`.
        start: the first mean [1, dims] instead of a uniform one.
        initial_std: standard deviation at a start, share of the box.
        separable: adapt the diagonal alone (sep-CMA-ES, Ros and Hansen 2008), for many dimensions.
        resampling: see above.

    Returns:
        The best position found; `evaluations` is pack_size * (iterations + 1).

    Raises:
        ValueError: a value is not a number.
    """
    tally = Tally(objective_fn, lower, upper, tie_break)
    kind = SepCMA if separable else CMA
    bounds = np.tile([0.0, 1.0], (len(lower), 1))
    mean = None if start is None else ((start[0] - lower) / (upper - lower)).cpu().double().numpy()
    distribution = None
    pack, values = lower[None], lower[:1]
    for _ in range(iterations + 1):
        if distribution is None or distribution.should_stop():
            seed, uniform = _draw(lower, generator)
            distribution = kind(
                mean=uniform if mean is None else mean,
                sigma=initial_std,
                bounds=bounds,
                n_max_resampling=resampling,
                seed=seed,
                population_size=pack_size,
            )
            mean = None
        samples = np.stack([distribution.ask() for _ in range(pack_size)])
        pack = (lower + (upper - lower) * torch.from_numpy(samples).to(lower)).clamp(lower, upper)
        values = tally(pack)
        order = best_first(pack, values, tie_break).tolist()
        distribution.tell([(samples[i], values[i].item()) for i in order])
    return tally.result(pack, values)


class CmaEs(PackOptimizer):
    """Weights that minimise the objective, by CMA-ES in every iteration.

    Args:
        pack_size: samples of a generation, at least 4.
        warm_start: the mean starts at the last iteration's weights.
        initial_std: standard deviation at a start, share of the box, above 0, at most 1.
        separable: adapt the diagonal of the covariance alone.
        resampling: how often a sample outside the box is drawn anew before it is clipped.
        Others: see `PackOptimizer`.

    Raises:
        ValueError: a setting outside its range.
    """

    min_pack_size = 4
    why_min_pack_size = "half of the samples make the new mean"

    def __init__(
        self,
        *arguments: Any,
        initial_std: float = 0.3,
        separable: bool = False,
        resampling: int = 5,
        **settings: Any,
    ) -> None:
        super().__init__(*arguments, **settings)
        check_number("initial_std", initial_std, 1e-6, 1.0)
        check_flag("separable", separable)
        check_integer("resampling", resampling, 1)
        self.initial_std = initial_std
        self.separable = separable
        self.resampling = resampling

    def search(self, objective_fn: WeightFunction) -> SearchResult:
        """One CMA-ES with the settings of this optimizer."""
        return cma_search(
            objective_fn,
            **self.search_settings(),
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
