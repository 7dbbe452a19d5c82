"""Particle swarm optimization (Kennedy and Eberhart 1995) with Clerc and Kennedy's constriction."""

from collections.abc import Callable
from functools import partial
from typing import Any

import torch
from torch import Tensor

from tlr_exp.optimizer.base import SearchResult, check_number
from tlr_exp.optimizer.box import uniform_positions
from tlr_exp.optimizer.pack import PackOptimizer, PackSearch, improves


def particle_swarm_search(
    objective_fn: Callable[[Tensor], Tensor],
    task: PackSearch,
    inertia: float,
    cognitive: float,
    social: float,
) -> SearchResult:
    """Minimise a function over a box.

    Every particle x with velocity v, its own best position p and the swarm's best g moves by
    v <- inertia v + cognitive r1 (p - x) + social r2 (g - x), x <- x + v, with r1, r2 ~ U(0, 1)
    fresh for each particle and dimension. The defaults of `ParticleSwarm` are Clerc and Kennedy's
    constriction 0.7298 for phi_1 = phi_2 = 2.05, in the form of Eberhart and Shi (2000):
    0.7298 * 2.05 = 1.49618.

    Velocities begin at half the way to another uniform position (Clerc's standard PSO 2007) and
    are limited to the width of the box (Eberhart and Shi). A particle that would leave the box
    stops at its wall: it is clipped there and loses that component of its velocity. The whole
    swarm moves at once, and g is the best position found so far.

    Args:
        objective_fn: positions [pack, dims] -> values [pack].
        task: its tie-break says whether a position that is as good as the old best replaces it.
        inertia, cognitive, social: the factors above.

    Raises:
        ValueError: a value is not a number.
    """
    tally = task.tally(objective_fn)
    lower, upper, generator = task.lower, task.upper, task.generator
    width = upper - lower
    x = task.first_pack()
    velocity = 0.5 * (uniform_positions(lower, upper, task.pack_size, generator) - x)
    values = tally(x)
    own, own_values = x, values
    for _ in range(task.iterations):
        r1, r2 = torch.rand((2, *x.shape), generator=generator, device=x.device, dtype=x.dtype)
        velocity = inertia * velocity + cognitive * r1 * (own - x) + social * r2 * (tally.best - x)
        velocity = velocity.clamp(-width, width)
        x = x + velocity
        inside = (x >= lower) & (x <= upper)
        x, velocity = x.clamp(lower, upper), velocity * inside
        values = tally(x)
        better = improves(x, values, own, own_values, task.tie_break)
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
        self.algorithm = partial(
            particle_swarm_search, inertia=inertia, cognitive=cognitive, social=social
        )
