"""Functions to minimise, with known minima, and a recorder of what a search asks of them."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import torch
from torch import Tensor

from tlr_exp.optimizer.search import SearchTask


def box(lower: float, upper: float, dims: int, seed: int = 0, **settings: Any) -> SearchTask:
    """What a search is told over [lower, upper]^dims, in float64."""
    return SearchTask(
        lower=torch.full((dims,), lower, dtype=torch.float64),
        upper=torch.full((dims,), upper, dtype=torch.float64),
        generator=torch.Generator().manual_seed(seed),
        **settings,
    )


class Recorder:
    """Wraps a function and keeps every position it was asked for, and its values."""

    def __init__(self, function: Callable[[Tensor], Tensor]) -> None:
        self.function = function
        self.packs: list[Tensor] = []
        self.values: list[Tensor] = []

    def __call__(self, pack: Tensor) -> Tensor:
        self.packs.append(pack.clone())
        self.values.append(self.function(pack))
        return self.values[-1]

    @property
    def calls(self) -> int:
        """Positions in all."""
        return sum(len(pack) for pack in self.packs)


def sphere(x: Any) -> Any:
    """Minimum 0 at 0."""
    return (x**2).sum(-1)


def shifted_sphere(x: Any) -> Any:
    """Minimum 0 at 1.3: GWO is drawn towards the origin, and must leave it."""
    return sphere(x - 1.3)


def rastrigin(x: Any) -> Any:
    """Minimum 0 at 0, among many local ones."""
    cosine = torch.cos if isinstance(x, Tensor) else np.cos
    return (x**2 - 10.0 * cosine(2.0 * math.pi * x) + 10.0).sum(-1)


def shifted_rastrigin(x: Any) -> Any:
    """Minimum 0 at 1.3."""
    return rastrigin(x - 1.3)


def plateau(x: Tensor) -> Tensor:
    """0 where the sum is at least half the dimensions; the origin is the worst of [0, 1]^n."""
    return (0.5 * x.shape[-1] - x.sum(-1)).clamp(min=0.0)


def constant(x: Tensor) -> Tensor:
    return torch.zeros(len(x), dtype=x.dtype)


def uneven_bowl(x: Tensor) -> Tensor:
    """Minimum 0 in [0, 1]^n, at 0.2, 0.9, 0.2, ...: neither at the origin nor on the diagonal."""
    minimum = torch.tensor([0.2, 0.9]).repeat(x.shape[-1])[: x.shape[-1]]
    return (x - minimum.to(x)).square().sum(-1).double()
