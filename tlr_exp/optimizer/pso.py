"""Particle swarm optimization (Kennedy and Eberhart 1995) with Clerc and Kennedy's constriction."""

from collections.abc import Callable
from dataclasses import dataclass

import torch
from torch import Tensor

from tlr_exp.config.checks import check_at_least, check_within
from tlr_exp.optimizer.base import ChosenWeights
from tlr_exp.optimizer.search import SearchResult, SearchTask, Tally, TieBreak, improves
from tlr_exp.reward.objectives import WeightFunction


def particle_swarm_search(
    objective_fn: Callable[[Tensor], Tensor],
    task: SearchTask,
    *,
    pack_size: int,
    iterations: int,
    inertia: float,
    cognitive: float,
    social: float,
) -> SearchResult:
    """Minimise a function over a box.

    Every particle x with velocity v, its own best position p and the swarm's best g moves by
    v <- inertia v + cognitive r1 (p - x) + social r2 (g - x), x <- x + v, with r1, r2 ~ U(0, 1)
    fresh for each particle and dimension. The values of `pso.yaml` are Clerc and Kennedy's
    constriction 0.7298 for phi_1 = phi_2 = 2.05, in the form of Eberhart and Shi (2000):
    0.7298 * 2.05 = 1.49618.

    Velocities begin at half the way to another uniform position (Clerc's standard PSO 2007) and
    are limited to the width of the box (Eberhart and Shi). A particle that would leave the box
    stops at its wall: it is clipped there and loses that component of its velocity. The whole
    swarm moves at once, and g is the best position found so far.

    Args:
        objective_fn: positions [pack, dims] -> values [pack].
        task: its tie-break says whether a position that is as good as the old best replaces it; the
            first particles begin at `start`.
        pack_size: particles.
        iterations: moves of the swarm, which is evaluated at first and after each.
        inertia, cognitive, social: the factors above.

    Raises:
        ValueError: a value is not a number.
    """
    tally = Tally(objective_fn, task)
    lower, upper, generator = task.lower, task.upper, task.generator
    width = upper - lower
    x = task.first_pack(pack_size)
    velocity = 0.5 * (task.uniform(pack_size) - x)
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
        better = improves(x, values, own, own_values, task.tie_break)
        own = torch.where(better[:, None], x, own)
        own_values = torch.where(better, values, own_values)
    return tally.result(x, values)


@dataclass(kw_only=True, eq=False)
class ParticleSwarm(ChosenWeights):
    """Weights that minimise the objective, by a particle swarm in every iteration.

    Attributes:
        pack_size: particles, at least 2.
        iterations: moves of the swarm per training iteration, at least 1.
        inertia: factor of the velocity, from 0 to 1.
        cognitive: largest pull towards the particle's own best position, from 0 to 4.
        social: largest pull towards the swarm's best position, from 0 to 4.
    """

    pack_size: int
    iterations: int
    lower: float
    upper: float
    tie_break: TieBreak
    warm_start: bool
    inertia: float
    cognitive: float
    social: float

    def __post_init__(self) -> None:
        super().__post_init__()
        self.set_box(self.lower, self.upper, self.tie_break)
        check_at_least("pack_size", self.pack_size, 2)
        check_at_least("iterations", self.iterations, 1)
        check_within("inertia", self.inertia, 0.0, 1.0)
        check_within("cognitive", self.cognitive, 0.0, 4.0)
        check_within("social", self.social, 0.0, 4.0)

    def search(self, objective_fn: WeightFunction) -> SearchResult:
        """One particle swarm search."""
        return particle_swarm_search(
            objective_fn,
            self.warm_task(self.warm_start),
            pack_size=self.pack_size,
            iterations=self.iterations,
            inertia=self.inertia,
            cognitive=self.cognitive,
            social=self.social,
        )
