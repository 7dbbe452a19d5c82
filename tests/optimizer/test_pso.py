"""Particle swarm: one move by hand, walls, and parity with mealpy's swarm."""

import math
import statistics
from collections.abc import Callable
from typing import Any

import pytest
import torch
from configured import make
from landscapes import Recorder, box, shifted_rastrigin, shifted_sphere
from mealpy import FloatVar
from mealpy.swarm_based.PSO import OriginalPSO

from tlr_exp.optimizer.pso import particle_swarm_search

DIMS, PACK_SIZE, ITERATIONS = 6, 30, 50
SIZES = {"pack_size": PACK_SIZE, "iterations": ITERATIONS}
CONSTRICTION = {"inertia": 0.7298, "cognitive": 1.49618, "social": 1.49618}


def search(function: Callable[..., Any], seed: int = 0) -> float:
    task = box(-5.0, 5.0, DIMS, seed)
    return particle_swarm_search(function, task, **SIZES, **CONSTRICTION).value


def mealpy_search(function: Callable[..., Any], seed: int) -> float:
    model = OriginalPSO(epoch=ITERATIONS, pop_size=PACK_SIZE, c1=1.49618, c2=1.49618, w=0.7298)
    problem = {
        "bounds": FloatVar(lb=(-5.0,) * DIMS, ub=(5.0,) * DIMS),
        "obj_func": function,
        "log_to": None,
    }
    return model.solve(problem, seed=seed).target.fitness


@pytest.mark.parametrize("function", [shifted_sphere, shifted_rastrigin])
def test_reaches_what_mealpy_reaches_with_the_same_budget(function: Callable[..., Any]) -> None:
    # Orders of magnitude: our mean logarithm over eight seeds within theirs by their deviation.
    theirs = [math.log(mealpy_search(function, seed)) for seed in range(8)]
    ours = [math.log(search(function, seed)) for seed in range(8)]
    assert statistics.mean(ours) <= statistics.mean(theirs) + statistics.stdev(theirs)


def test_the_first_move_by_hand() -> None:
    # Random numbers come as positions, their partners for the velocities, then r1 and r2. Before
    # the first move every particle is its own best; the swarm's best is the smallest.
    generator = torch.Generator().manual_seed(4)
    x, partner = torch.rand(2, 3, 1, generator=generator, dtype=torch.float64)
    _, r2 = torch.rand(2, 3, 1, generator=generator, dtype=torch.float64)
    best = x.min().item()
    expected = []
    for particle in range(3):
        here = x[particle].item()
        velocity = (partner[particle].item() - here) / 2
        velocity = 0.5 * velocity + 2.0 * r2[particle].item() * (best - here)
        expected.append(min(max(here + min(max(velocity, -1.0), 1.0), 0.0), 1.0))

    recorder = Recorder(lambda position: position[:, 0])
    factors = {"inertia": 0.5, "cognitive": 1.0, "social": 2.0}
    particle_swarm_search(recorder, box(0.0, 1.0, 1, seed=4), pack_size=3, iterations=1, **factors)
    assert torch.equal(recorder.packs[0], x)
    torch.testing.assert_close(recorder.packs[1].flatten().tolist(), expected)


def test_a_particle_that_meets_a_wall_loses_that_part_of_its_velocity() -> None:
    # Inertia alone: without a wall a particle never stops; at one it stays for ever.
    recorder = Recorder(lambda position: position[:, 0])
    task, factors = box(0.0, 1.0, 2, seed=1), {"inertia": 1.0, "cognitive": 0.0, "social": 0.0}
    particle_swarm_search(recorder, task, pack_size=10, iterations=500, **factors)
    last = recorder.packs[-1]
    assert ((last == 0.0) | (last == 1.0)).all()
    assert torch.equal(last, recorder.packs[-2])


@pytest.mark.parametrize("name", ["inertia", "cognitive", "social"])
def test_bad_factors_are_refused(name: str) -> None:
    with pytest.raises(ValueError, match=rf"{name} is 7; allowed: from 0 to \d"):
        make("pso", **{name: 7})
