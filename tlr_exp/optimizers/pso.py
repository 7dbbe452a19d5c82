"""Particle swarm optimization (Kennedy and Eberhart 1995) with Clerc and Kennedy's constriction."""

from collections.abc import Callable
from typing import Any

import torch
from torch import Tensor

from tlr_exp.objective import WeightFunction
from tlr_exp.optimizers.base import SearchResult, check_number
from tlr_exp.optimizers.box import uniform_positions
from tlr_exp.optimizers.pack import PackOptimizer, Tally, TieBreak, first_pack, improves


def particle_swarm_search(
    objective_fn: Callable[[Tensor], Tensor],
    lower: Tensor,
    upper: Tensor,
    pack_size: int,
    iterations: int,
    generator: torch.Generator,
    tie_break: TieBreak = "first",
    start: Tensor | None = None,
    inertia: float = 0.7298,
    cognitive: float = 1.49618,
    social: float = 1.49618,
) -> SearchResult:
    """Minimise a function over a box.

    Every particle x with velocity v, its own best position p and the swarm's best g moves by
    v <- inertia v + cognitive r1 (p - x) + social r2 (g - x), x <- x + v, with r1, r2 ~ U(0, 1)
    fresh for each particle and dimension. The defaults are Clerc and Kennedy's constriction 0.7298
    for phi_1 = phi_2 = 2.05, in the form of Eberhart and Shi (2000): 0.7298 * 2.05 = 1.49618.

    Velocities begin at half the way to another uniform position (Clerc's standard PSO 2007) and
    are limited to the width of the box (Eberhart and Shi). A particle that would leave the box
    stops at its wall: it is clipped there and loses that component of its velocity. The whole
    swarm moves at once, and g is the best position found so far.

    Args:
        objective_fn: positions [pack, dims] -> values [pack].
        lower: lower bounds [dims]. Its device and dtype are those of the search.
        upper: upper bounds [dims].
        pack_size: number of particles.
        iterations: number of moves.
        generator: source of all random numbers, on the device of `lower`.
        tie_break: whether a position that is as good as the old best replaces it, see `pack`.
        start: positions [n, dims] that replace the first n of the random swarm.
        inertia, cognitive, social: the factors above.

    Returns:
        The best position found; `evaluations` is pack_size * (iterations + 1).

    Raises:
        ValueError: a value is not a number.
    """
    tally = Tally(objective_fn, lower, upper, tie_break)
    width = upper - lower
    x = first_pack(lower, upper, pack_size, generator, start)
    velocity = 0.5 * (uniform_positions(lower, upper, pack_size, generator) - x)
    values = tally(x)
    own, own_values = x, values
    for _ in range(iterations):
        r1, r2 = torch.rand((2, *x.shape), generator=generator, device=x.device, dtype=x.dtype)
        velocity = inertia * velocity + cognitive * r1 * (own - x) + social * r2 * (tally.best - x)
        velocity = velocity.clamp(-width, width)
        x = x + velocity
        inside = (x >= lower) & (x <= upper)
        x, velocity = x.clamp(lower, upper), velocity * inside
        values = tally(x)
        better = improves(x, values, own, own_values, tie_break)
        own = torch.where(better[:, None], x, own)
        own_values = torch.where(better, values, own_values)
    return tally.result(x, values)


class ParticleSwarm(PackOptimizer):
    """Weights that minimise the objective, by a particle swarm in every iteration.

    Args:
        inertia: factor of the velocity, from 0 to 1.
        cognitive: largest pull towards the particle's own best position, from 0 to 4.
        social: largest pull towards the swarm's best position, from 0 to 4.
        Others: see `PackOptimizer`.

    Raises:
        ValueError: a setting outside its range.
    """

    def __init__(
        self,
        *arguments: Any,
        inertia: float = 0.7298,
        cognitive: float = 1.49618,
        social: float = 1.49618,
        **settings: Any,
    ) -> None:
        super().__init__(*arguments, **settings)
        check_number("inertia", inertia, 0.0, 1.0)
        check_number("cognitive", cognitive, 0.0, 4.0)
        check_number("social", social, 0.0, 4.0)
        self.inertia = inertia
        self.cognitive = cognitive
        self.social = social

    def search(self, objective_fn: WeightFunction) -> SearchResult:
        """One particle swarm search with the settings of this optimizer."""
        return particle_swarm_search(
            objective_fn,
            **self.search_settings(),
            inertia=self.inertia,
            cognitive=self.cognitive,
            social=self.social,
        )
