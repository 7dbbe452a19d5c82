"""Differential evolution: how trials are made, and parity with SciPy's."""

import math
import statistics
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import torch
from configured import make
from landscapes import Recorder, box, constant, rastrigin, shifted_rastrigin, shifted_sphere
from scipy.optimize import differential_evolution

from tlr_exp.optimizer.differential_evolution import (
    Strategy,
    _different,
    differential_evolution_search,
)
from tlr_exp.optimizer.search import SearchResult, SearchTask

DIMS, PACK_SIZE, ITERATIONS = 6, 30, 50


def search_box(
    function: Callable[..., Any],
    task: SearchTask,
    pack_size: int,
    iterations: int,
    strategy: Strategy = "rand1bin",
    scale: float = 0.5,
    crossover: float = 0.9,
) -> SearchResult:
    return differential_evolution_search(
        function,
        task,
        pack_size=pack_size,
        iterations=iterations,
        strategy=strategy,
        scale=scale,
        crossover=crossover,
    )


def search(function: Callable[..., Any], seed: int, strategy: Strategy) -> float:
    return search_box(function, box(-5.0, 5.0, DIMS, seed), PACK_SIZE, ITERATIONS, strategy).value


def scipy_search(function: Callable[..., Any], strategy: str, seed: int) -> float:
    rng = np.random.default_rng(seed)
    return differential_evolution(
        function,
        [(-5.0, 5.0)] * DIMS,
        strategy=strategy,
        mutation=0.5,
        recombination=0.9,
        init=rng.uniform(-5.0, 5.0, (PACK_SIZE, DIMS)),
        maxiter=ITERATIONS,
        updating="deferred",
        polish=False,
        tol=0.0,
        rng=rng,
    ).fun


@pytest.mark.parametrize("strategy", ["rand1bin", "best1bin"])
@pytest.mark.parametrize("function", [shifted_sphere, shifted_rastrigin])
def test_reaches_what_scipy_reaches_with_the_same_budget(
    function: Callable[..., Any], strategy: Any
) -> None:
    theirs = [math.log(scipy_search(function, strategy, seed)) for seed in range(10)]
    ours = [math.log(search(function, seed, strategy)) for seed in range(10)]
    spread = statistics.stdev(theirs)
    assert abs(statistics.mean(ours) - statistics.mean(theirs)) <= 1.5 * spread


def test_the_three_others_are_others_and_equally_likely() -> None:
    generator = torch.Generator().manual_seed(0)
    draws = torch.stack([_different(5, generator) for _ in range(2000)])  # [2000, 5, 3]
    members = torch.cat([torch.arange(5)[None, :, None].expand(2000, 5, 1), draws], dim=2)
    assert all(len(set(row)) == 4 for row in members.flatten(0, 1).tolist())
    # Of member 0, each of the four others is drawn first in a quarter of the cases.
    counts = torch.bincount(draws[:, 0, 0], minlength=5)
    assert counts[0] == 0
    assert ((counts[1:] - 500).abs() < 5 * (2000 * 0.25 * 0.75) ** 0.5).all()


def test_a_mutant_is_a_member_and_a_difference_of_two_others() -> None:
    # With the whole mutant taken (crossover 1), and small enough to stay in the box.
    recorder = Recorder(constant)
    search_box(recorder, box(0.0, 1.0, 2, seed=3), 5, 1, scale=0.1, crossover=1.0)
    pack, trials = recorder.packs
    for target, trial in enumerate(trials):
        others = [pack[i] for i in range(5) if i != target]
        made = [
            base + 0.1 * (plus - minus)
            for base in others
            for plus in others
            for minus in others
            if base is not plus and plus is not minus and base is not minus
        ]
        distance = torch.stack([(m.clamp(0.0, 1.0) - trial).norm() for m in made])
        assert distance.min() < 1e-12


def test_without_crossover_one_component_comes_from_the_mutant() -> None:
    recorder = Recorder(constant)
    search_box(recorder, box(0.0, 1.0, 4, seed=3), 8, 1, scale=0.3, crossover=0.0)
    changed = (recorder.packs[0] != recorder.packs[1]).sum(dim=1)
    assert (changed <= 1).all()  # clipping at a wall may leave it as it was
    assert changed.sum() >= 6


def test_the_population_never_gets_worse() -> None:
    recorder = Recorder(rastrigin)
    found = search_box(recorder, box(-5.0, 5.0, 3), 12, 30)
    first = recorder.values[0].sort().values
    assert (found.pack_values.sort().values <= first).all()
    assert found.pack_values.min() == found.value


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"pack_size": 3}, "pack_size is 3; allowed: at least 4"),
        ({"strategy": "best2bin"}, "strategy is 'best2bin'; allowed: rand1bin, best1bin"),
        ({"scale": -0.5}, r"scale is -0\.5; allowed: from 0 to 2"),
        ({"crossover": 1.5}, r"crossover is 1\.5; allowed: from 0 to 1"),
    ],
)
def test_bad_settings_are_refused(settings: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        make("differential_evolution", **settings)
