"""What the optimizers are compared on: test functions, and J on recorded trajectories.

All values are errors: 0 is the best that is known to be possible.
"""

import json
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from tlr_exp.reward.objectives import RankDeviation

LANDSCAPES = Path(__file__).with_name("landscapes.npz")
DIMS = (6, 30, 100)
HALF_WIDTH = 5.0
SHIFT = 0.6  # of the half width: where minima lie
SMALLEST_WEIGHTS = (0.0, 0.1)


@dataclass(frozen=True)
class Problem:
    """A function to minimise over the box [lower, upper]^dims.

    Attributes:
        group: problems of one table.
        name: within the group.
        value: positions [n, dims] -> errors [n], float64.
    """

    group: str
    name: str
    dims: int
    lower: float
    upper: float
    value: Callable[[Tensor], Tensor]


def sphere(x: Tensor) -> Tensor:
    """Minimum 0 at 0."""
    return x.square().sum(dim=1)


def rastrigin(x: Tensor) -> Tensor:
    """Minimum 0 at 0, among a local one at nearly every whole number."""
    return (x.square() - 10.0 * (2.0 * math.pi * x).cos() + 10.0).sum(dim=1)


def rosenbrock(x: Tensor) -> Tensor:
    """Minimum 0 at 0 (usually at 1), at the end of a curved valley."""
    x = x + 1.0
    along, across = 1.0 - x[:, :-1], x[:, 1:] - x[:, :-1].square()
    return (along.square() + 100.0 * across.square()).sum(dim=1)


def ackley(x: Tensor) -> Tensor:
    """Minimum 0 at 0, in a funnel of local ones."""
    funnel = -20.0 * (-0.2 * x.square().mean(dim=1).sqrt()).exp()
    return funnel - (2.0 * math.pi * x).cos().mean(dim=1).exp() + 20.0 + math.e


FUNCTIONS: Mapping[str, Callable[[Tensor], Tensor]] = {
    "sphere": sphere,
    "Rastrigin": rastrigin,
    "Rosenbrock": rosenbrock,
    "Ackley": ackley,
}


def shifted_functions(seed: int) -> list[Problem]:
    """Every function in every dimension, with its minimum at a random place of its own.

    At the origin, where textbooks have it, GWO would be drawn to it; with equal coordinates OSPO,
    whose start points lie on the diagonal.
    """
    rng = np.random.default_rng(seed)
    problems = []
    for dims in DIMS:
        for name, function in FUNCTIONS.items():
            limit = SHIFT * HALF_WIDTH
            minimum = torch.from_numpy(rng.uniform(-limit, limit, dims))
            value = _shifted(function, minimum)
            group = f"{dims} dimensions"
            problems.append(Problem(group, name, dims, -HALF_WIDTH, HALF_WIDTH, value))
    return problems


def _shifted(function: Callable[[Tensor], Tensor], minimum: Tensor) -> Callable[[Tensor], Tensor]:
    return lambda x: function(x.double() - minimum)


def recorded_landscapes(path: Path = LANDSCAPES) -> list[Problem]:
    """The paper's J on the trajectories of some iterations of a training.

    Over the paper's box [0, 1], in which weights 0 always give J = 0; and with a smallest weight
    of 0.1, so that every penalty has a say and there is something to be found.
    """
    with np.load(path) as saved:
        about = json.loads(str(saved["about"]))
        arrays = {name: torch.from_numpy(saved[name]) for name in saved.files if name != "about"}
    iterations = sorted(int(name.rpartition("_")[2]) for name in arrays if "goal" in name)
    problems = []
    for lower in SMALLEST_WEIGHTS:
        for iteration in iterations:
            function = RankDeviation(0.1).prepare(
                arrays[f"goal_return_{iteration}"], arrays[f"term_returns_{iteration}"]
            )
            group = f"J, weights from {lower:g} to 1"
            name = f"iteration {iteration}"
            problems.append(Problem(group, name, len(about["terms"]), lower, 1.0, function))
    return problems
