"""Run every search on every problem from every seed."""

import time
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass

import numpy as np

from benchmarks.optimizers.problems import Problem, recorded_landscapes, shifted_functions
from benchmarks.optimizers.searches import Search


@dataclass(frozen=True)
class Measurement:
    """One search: the error at the budget, and the processor time that it took."""

    group: str
    problem: str
    search: str
    seed: int
    error: float
    seconds: float


@dataclass(frozen=True)
class Summary:
    """The searches of one kind on one problem: quartiles of the error, median time."""

    group: str
    problem: str
    search: str
    seeds: int
    lower_quartile: float
    median: float
    upper_quartile: float
    seconds: float


def measure(searches: Mapping[str, Search], seeds: Iterable[int]) -> list[Measurement]:
    """All measurements. A seed has the same test functions for every search."""
    found = []
    landscapes = recorded_landscapes()
    for seed in seeds:
        for problem in (*shifted_functions(seed), *landscapes):
            for name, search in searches.items():
                found.append(_measured(problem, name, search, seed))
        print(f"seed {seed}: {len(found)} searches in all", flush=True)
    return found


def _measured(problem: Problem, name: str, search: Search, seed: int) -> Measurement:
    started = time.process_time()
    error = search(problem, seed)
    seconds = time.process_time() - started
    return Measurement(problem.group, problem.name, name, seed, error, seconds)


def summarise(measurements: Sequence[Measurement]) -> list[Summary]:
    """Quartiles over the seeds.

    Where weights 0 are excluded the smallest J is not known: there the error is what J exceeds the
    smallest by that any search found on these trajectories.
    """
    smallest: dict[tuple[str, str], float] = {}
    cells: dict[tuple[str, str, str], list[Measurement]] = {}
    for one in measurements:
        cells.setdefault((one.group, one.problem, one.search), []).append(one)
        if one.group.startswith("J"):
            key = one.group, one.problem
            smallest[key] = min(one.error, smallest.get(key, np.inf))
    return [_summary(key, cell, smallest.get(key[:2], 0.0)) for key, cell in cells.items()]


def _summary(key: tuple[str, str, str], cell: Sequence[Measurement], smallest: float) -> Summary:
    errors = [one.error - smallest for one in cell]
    low, middle, high = (float(q) for q in np.quantile(errors, (0.25, 0.5, 0.75)))
    seconds = float(np.median([one.seconds for one in cell]))
    return Summary(*key, len(cell), low, middle, high, seconds)


def as_records(summaries: Sequence[Summary]) -> list[dict[str, object]]:
    """Plain data, for a JSON file."""
    return [asdict(summary) for summary in summaries]
