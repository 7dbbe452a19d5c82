"""Search only the weights that move J, as screened by elementary effects.

The paper names EDEM (effective dimension extraction: search only the dimensions that matter) as
further work for many weights, without a description. This is this project's reading of that remark,
not the paper's method: Morris' screening (Technometrics 1991) with the mean absolute effect mu* of
Campolongo, Cariboni and Saltelli (2007).
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import torch
from torch import Tensor

from tlr_exp.config.checks import check_at_least, check_within
from tlr_exp.errors import UserError
from tlr_exp.optimizer.base import ChosenWeights
from tlr_exp.optimizer.search import SearchResult, Tally, moves_within, unsearched
from tlr_exp.reward.objectives import WeightFunction

_NUM_SEEDS = 2**63 - 1


@dataclass(frozen=True)
class Trajectories:
    """Random walks through a grid of the unit cube that move every coordinate once.

    Attributes:
        points: [walks, dims + 1, dims].
        order: order[w, d] is the step at which walk w moves coordinate d [walks, dims].
        direction: +1 where that step goes up, -1 where it goes down [walks, dims].
    """

    points: Tensor
    order: Tensor
    direction: Tensor


def morris_trajectories(
    dims: int, walks: int, levels: int, generator: torch.Generator
) -> Trajectories:
    """Morris' random orientations of a walk; every step has the length levels / (2 (levels - 1)).

    Args:
        dims: number of coordinates.
        walks: number of walks.
        levels: even number of grid values in [0, 1].
        generator: source of all random numbers; the walks are on its device.
    """
    device, shape = generator.device, (walks, dims)
    step = levels / (2 * (levels - 1))
    low = torch.randint(levels // 2, shape, generator=generator, device=device) / (levels - 1)
    up = torch.rand(shape, generator=generator, device=device) < 0.5
    order = torch.rand(shape, generator=generator, device=device).argsort(dim=1)
    moved = order[:, None, :] < torch.arange(dims + 1, device=device)[:, None]
    points = low[:, None, :] + step * (moved == up[:, None, :])
    return Trajectories(points, order, up.double() * 2.0 - 1.0)


def mean_absolute_effects(walks: Trajectories, values: Tensor, levels: int) -> Tensor:
    """mu* of each coordinate [dims]: mean over the walks of |change of value| / step.

    Args:
        walks: W walks over D coordinates.
        values: the function at their points [W, D + 1].
        levels: those of the walks.
    """
    changes = values.diff(dim=1).gather(1, walks.order)  # step k moves the coordinate of order k
    return (changes * walks.direction / (levels / (2 * (levels - 1)))).abs().mean(dim=0)


@dataclass(kw_only=True, eq=False)
class EffectiveDimension(ChosenWeights):
    """Screens the weights anew in every iteration, and searches only those that move J.

    All other weights stay at `rest`. Where no weight moves J, all do, and there is no search. Terms
    count as moving J if their mu* is at least `min_share` of the largest.

    Attributes:
        inner: makes the search over the remaining weights from num_terms, objective, seed and
            device; it is made anew in every iteration, with a seed that this optimizer draws.
        budget: evaluations, screening included: `walks` * (num_terms + 1) for it, and at most what
            is left for the search.
        walks: walks of the screening, at least 1.
        levels: values in [0, 1] that a weight takes in the screening, an even number.
        min_share: see above, from 0 to 1.
        rest: the value of a weight that is not searched, within the box of `inner`.
    """

    inner: Callable[..., ChosenWeights]
    budget: int
    walks: int
    levels: int
    min_share: float
    rest: float

    def __post_init__(self) -> None:
        super().__post_init__()
        check_at_least("walks", self.walks, 1)
        check_at_least("levels", self.levels, 2)
        if self.levels % 2:
            raise UserError(
                f"levels must be even, got {self.levels}: each half is reached from the other"
            )
        check_within("min_share", self.min_share, 0.0, 1.0)
        probe: Any = self.inner(
            num_terms=self.num_terms, objective=self.objective, seed=0, device=self.device
        )
        _check_inner(probe)
        check_within("rest", self.rest, probe.lower, probe.upper)
        self.set_box(probe.lower, probe.upper, tie_break="first")
        self.screening = self.walks * (self.num_terms + 1)
        check_at_least(
            f"budget, of which the screening takes {self.screening},",
            self.budget,
            self.screening + 1,
        )
        self.inner_budget = setting_for(probe, self.budget - self.screening)

    def search(self, objective_fn: WeightFunction) -> SearchResult:
        """Screen, then search the weights that move J."""
        rest = torch.full_like(self.task.lower, self.rest)
        moving = self._screen(objective_fn).nonzero()[:, 0]
        if not len(moving):
            return replace(unsearched(rest, objective_fn), evaluations=self.screening)
        seed = torch.randint(_NUM_SEEDS, (1,), generator=self.generator, device=self.device)
        inner = self.inner(
            num_terms=len(moving),
            objective=self.objective,
            seed=int(seed),
            device=self.device,
            **self.inner_budget,
        )
        inner.last_weights = self.last_weights[moving]

        def whole(part: Tensor) -> Tensor:
            return rest.repeat(len(part), 1).index_copy(1, moving, part)

        found = inner.search(lambda part: objective_fn(whole(part)))
        return replace(
            found,
            position=whole(found.position[None])[0],
            pack=whole(found.pack),
            evaluations=self.screening + found.evaluations,
        )

    def _screen(self, objective_fn: WeightFunction) -> Tensor:
        """Which weights move J [num_terms] bool."""
        walks = morris_trajectories(self.num_terms, self.walks, self.levels, self.generator)
        lower, width = self.task.lower, self.task.upper - self.task.lower
        tally = Tally(objective_fn, self.task)
        values = [tally(lower + width * points) for points in walks.points.to(lower)]
        effects = mean_absolute_effects(walks, torch.stack(values), self.levels)
        return (effects > 0) & (effects >= self.min_share * effects.max())


def setting_for(search: Any, evaluations: int) -> dict[str, int]:
    """The setting with which a search like this one takes at most so many evaluations.

    Raises:
        UserError: too few for a pack of its size.
    """
    if hasattr(search, "budget"):
        return {"budget": evaluations}
    return {"iterations": moves_within(evaluations, search.pack_size)}


def _check_inner(inner: Any) -> None:
    if not (hasattr(inner, "lower") and (hasattr(inner, "budget") or hasattr(inner, "pack_size"))):
        raise UserError(
            f"inner makes a {type(inner).__name__}, which does not search: use an optimizer that "
            "minimises J, such as gwo"
        )
    kept = set(inner.state_dict()) - {"generator", "last_weights"}
    if kept:
        raise UserError(
            f"inner keeps its {', '.join(sorted(kept))} between iterations, but the weights that "
            "are searched change: use inner.persistent=false"
        )
