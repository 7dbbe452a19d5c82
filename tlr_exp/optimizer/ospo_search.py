"""The search of OSPO: how its steps follow one another. `ospo.py` says what was chosen and why."""

import itertools
import math
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field

import torch
from torch import Tensor

from tlr_exp.optimizer import ospo_steps as steps
from tlr_exp.optimizer.search import (
    BudgetSpent,
    SearchResult,
    SearchTask,
    Tally,
    best_first,
    improves,
)

NUM_NEIGHBOURS = 10
JUMP_TRIALS = 10
EXTRAPOLATE_FROM = 4  # inner iterations
EXTRA_ITERATIONS = 10
ISOTROPY_STEP = 0.1
STD_FLOOR = 0.01
LOCAL_ROUND = 10
LAST_SEARCH_AT = 0.7  # of the budget


@dataclass(frozen=True)
class OspoSettings:
    """Sizes of the search.

    Attributes:
        population: samples of an inner iteration (published: 40).
        elites: the best of them, which make the next distribution (10).
        inner_iterations: of a path (30).
        start_points: on the diagonal, one a path; then the first again (max(100, dims)).
    """

    population: int
    elites: int
    inner_iterations: int
    start_points: int


@dataclass
class Ranked:
    """Positions [n, dims] in the unit cube and their values [n], the best first."""

    positions: Tensor
    values: Tensor

    @property
    def best_value(self) -> float:
        return self.values[0].item()


@dataclass
class Path:
    """One path: the state that its inner iterations share."""

    mean: Tensor
    covariance: Tensor
    kick: float
    kicked: bool = False
    isotropy: float = 0.0
    population: Ranked | None = None
    local_elites: list[tuple[Tensor, float]] = field(default_factory=list)


class OspoSearch:
    """One search; see `ospo_search`."""

    def __init__(self, tally: Tally, budget: int, settings: OspoSettings) -> None:
        self.tally, self.budget, self.settings = tally, budget, settings
        self.task = tally.task
        self.generator = self.task.generator
        self.dims = len(self.task.lower)
        self.last: Ranked | None = None  # the last population, to be reported
        self.start_std = 1.0 / (3.0 * settings.start_points)

    def run(self) -> None:
        """Paths from one start after the other until `LAST_SEARCH_AT`, then the local search."""
        starts = self._starts()
        for number in itertools.count():
            start = starts.positions[number % len(starts.positions)]
            floor = STD_FLOOR / 2.0**number
            self._follow(self._new_path(start, first=number == 0), floor)
            if self._spent() >= LAST_SEARCH_AT:
                self._local_search(floor, rounds=None)
            self._local_search(floor, rounds=max(1, self.settings.population // LOCAL_ROUND))

    def _starts(self) -> Ranked:
        """Step 1: the start points, each the best of itself and its neighbours; best first."""
        count = self.settings.start_points
        points = steps.diagonal_points(count, self.dims, self.generator)
        around = steps.neighbours(points, self.start_std, NUM_NEIGHBOURS, self.generator)
        groups = torch.cat([points[:, None], around], dim=1)
        best = [self._evaluate(group) for group in groups]
        return self._ranked(
            torch.stack([group.positions[0] for group in best]),
            torch.stack([group.values[0] for group in best]),
        )

    def _new_path(self, start: Tensor, first: bool) -> Path:
        """Step 1 and the restart of step 9: where a path begins and how far it looks."""
        kick = math.sqrt(self.dims) * self.start_std**2
        variance = min(self.start_std, steps.STAGE_STD) ** 2 if first else kick / self.dims**0.5
        eye = torch.eye(self.dims, device=start.device, dtype=start.dtype)
        return Path(start, variance * eye, kick)

    def _follow(self, path: Path, floor: float) -> None:
        """Steps 2 to 8 until the path ends, or the last local search is due."""
        iterations = self.settings.inner_iterations
        iteration = 0
        while iteration < iterations and self._spent() < LAST_SEARCH_AT:
            iteration += 1
            kicked_before = path.kicked
            samples = self._sample(path)
            self._jump(path)
            elites = self._elites(path)
            mean = self._centre(elites)
            covariance = steps.covariance_of(elites.positions)
            self._note_elite(path)
            if iteration >= EXTRAPOLATE_FROM:
                self._extrapolate(path)
            path.mean = 0.5 * (mean + self._attractor(path))
            path.covariance = self._adapt(path, covariance, samples, floor)
            if path.kicked and not kicked_before:
                iterations += EXTRA_ITERATIONS

    def _sample(self, path: Path) -> Tensor:
        """Step 2: new samples [n, dims], merged rank by rank with the population."""
        size = self.settings.population
        first = path.population is None
        count = 3 * size + 1 if first else size
        samples = steps.normal_samples(path.mean, path.covariance, count, self.generator)
        new = self._evaluate(samples)
        new = Ranked(new.positions[:size], new.values[:size])
        old = path.population
        if old is not None:
            better = improves(
                new.positions, new.values, old.positions, old.values, self.task.tie_break
            )
            new = self._ranked(
                torch.where(better[:, None], new.positions, old.positions),
                torch.where(better, new.values, old.values),
            )
        path.population = self.last = new
        return samples

    def _jump(self, path: Path) -> None:
        """Step 3: ten trials beyond the best elite."""
        elites = self._elites(path)
        pairs = torch.rand(
            (JUMP_TRIALS, len(elites.values)), generator=self.generator, device=self._device
        ).argsort(dim=1)[:, :2]
        one, other = elites.positions[pairs].unbind(dim=1)
        direction = steps.jump_directions(
            elites.positions[:3], elites.values[:3], (one - other).norm(dim=1)
        )
        stretch = 0.5 + self._uniform(JUMP_TRIALS, self.dims)
        stretch[self._uniform(JUMP_TRIALS) < 0.5] = 1.0
        self._join(path, (elites.positions[0] + direction * stretch).clamp(0.0, 1.0))

    def _centre(self, elites: Ranked) -> Tensor:
        """Step 4: the weighted mean of the elites or the best of them, with equal chances."""
        if self._uniform(1).item() < 0.5:
            return steps.weighted_mean(elites.positions, elites.values)
        return elites.positions[0]

    def _extrapolate(self, path: Path) -> None:
        """Step 5: points along the way from the latest worse local elite."""
        *earlier, (elite, value) = path.local_elites
        for age, (worse, worse_value) in enumerate(reversed(earlier), start=1):
            if worse_value > value:
                self._join(path, steps.extrapolations(elite, worse, age, self.generator))
                path.local_elites.pop()
                self._note_elite(path)
                return

    def _attractor(self, path: Path) -> Tensor:
        """Step 6: the local elite, or the global one once half of the budget is spent."""
        return path.local_elites[-1][0] if self._spent() < 0.5 else self._global_elite()

    def _adapt(self, path: Path, covariance: Tensor, samples: Tensor, floor: float) -> Tensor:
        """Steps 7 and 8: the energy of the covariance, its isotropy, and its floor."""
        present, limit = steps.energy(covariance), steps.energy_limit(self.dims)
        if 0.0 < present < limit:
            of_samples = steps.energy(steps.covariance_of(samples))
            if present < of_samples:
                percent = self._improvement(path)
                factor = steps.grown_factor(present, of_samples, percent, limit)
            else:
                factor = steps.kicked_factor(present, path.kick)
                path.kick /= 2.0
                path.kicked = True
            covariance = factor * covariance
        path.isotropy += ISOTROPY_STEP
        if self._uniform(1).item() < path.isotropy:
            covariance, path.isotropy = steps.isotropic(covariance), 0.0
        return steps.with_floor(covariance, floor)

    def _local_search(self, std: float, rounds: int | None) -> None:
        """Step 9: Gaussian points around the best; without `rounds` until the budget is spent."""
        for _ in itertools.count() if rounds is None else range(rounds):
            before = self.tally.best_value.item()
            centre = self._global_elite()[None]
            points = steps.neighbours(centre, std, LOCAL_ROUND, self.generator)[0]
            self.last = self._evaluate(points)
            better = self.tally.best_value.item() < before
            std = min(2.0 * std, steps.STAGE_STD) if better else 0.5 * std

    # --- what the steps share ----------------------------------------------------------------

    def _evaluate(self, points: Tensor) -> Ranked:
        """Value points [n, dims] of the unit cube, and sort them."""
        lower, upper = self.task.lower, self.task.upper
        return self._ranked(points, self.tally(lower + (upper - lower) * points).double())

    def _ranked(self, positions: Tensor, values: Tensor) -> Ranked:
        order = best_first(positions, values, self.task.tie_break)
        return Ranked(positions[order], values[order])

    def _join(self, path: Path, points: Tensor) -> None:
        """Let new points into the population, from which the worst drop out."""
        new, old = self._evaluate(points), path.population
        assert old is not None
        both = self._ranked(
            torch.cat([old.positions, new.positions]), torch.cat([old.values, new.values])
        )
        size = self.settings.population
        path.population = self.last = Ranked(both.positions[:size], both.values[:size])

    def _elites(self, path: Path) -> Ranked:
        assert path.population is not None
        count = self.settings.elites
        return Ranked(path.population.positions[:count], path.population.values[:count])

    def _note_elite(self, path: Path) -> None:
        assert path.population is not None
        path.local_elites.append((path.population.positions[0], path.population.best_value))

    def _improvement(self, path: Path) -> float:
        """P of step 7: by how much the local elite became better in this inner iteration."""
        if len(path.local_elites) < 2:
            return 0.0
        (_, before), (_, after) = path.local_elites[-2:]
        return steps.improvement_percent(before, after)

    def _global_elite(self) -> Tensor:
        lower, upper = self.task.lower, self.task.upper
        return ((self.tally.best[0] - lower) / (upper - lower)).double()

    def _spent(self) -> float:
        return self.tally.evaluations / self.budget

    def _uniform(self, *shape: int) -> Tensor:
        return torch.rand(shape, generator=self.generator, device=self._device, dtype=torch.float64)

    @property
    def _device(self) -> torch.device:
        return self.task.lower.device


def ospo_search(
    objective_fn: Callable[[Tensor], Tensor],
    task: SearchTask,
    budget: int,
    settings: OspoSettings,
) -> SearchResult:
    """Minimise a function over a box with exactly `budget` evaluations.

    Args:
        objective_fn: positions [n, dims] -> values [n].
        task: the box, of whose dtype the positions are that are valued; the random numbers; ties.
        budget: evaluations.
        settings: sizes of the search.

    Raises:
        ValueError: a value is not a number.
    """
    tally = Tally(objective_fn, task, budget)
    search = OspoSearch(tally, budget, settings)
    with suppress(BudgetSpent):
        search.run()
    if search.last is None:  # the budget ended among the start points
        return tally.result(tally.best, tally.best_value)
    lower, upper = task.lower, task.upper
    pack = lower + (upper - lower) * search.last.positions.to(lower)
    return tally.result(pack.clamp(lower, upper), search.last.values)
