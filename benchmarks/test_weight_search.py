"""Time of one weight search at the paper's scale, on one thread.

30 wolves, 50 moves, 4096 trajectories, 7 terms: 1530 values of J. Run with

    pytest benchmarks/test_weight_search.py

Two sets of trajectories: `mild`, in which penalties are a tenth of the goal return and the pack
soon stands where few candidates fall, and `harsh`, in which they outweigh it.
"""

import statistics
import time
from collections.abc import Callable, Iterator

import pytest
import torch
from pytest_benchmark.fixture import BenchmarkFixture
from torch import Tensor

from benchmarks.optimizers.searches import configured
from tlr_exp.optimizer.gwo import GreyWolfOptimizer
from tlr_exp.reward.objectives import Objective, RankDeviation

NUM_ENVS = 4096
NUM_TERMS = 7
PENALTY_SCALE = {"mild": 0.1, "harsh": 2.0}
LARGEST_RATIO = 0.2  # to the plain sort; measured 0.06 and 0.07


class PlainRankDeviation:
    """J as one would write it down: two argsorts of every row give every rank."""

    def prepare(self, goal_return: Tensor, term_returns: Tensor) -> Callable[[Tensor], Tensor]:
        """J as a function of the weights [pack, num_terms]."""
        num_candidates = int(0.10 * len(goal_return))
        candidates = goal_return.argsort(descending=True, stable=True)[:num_candidates]
        initial_rank = torch.arange(1, num_candidates + 1)

        def objective(weights: Tensor) -> Tensor:
            total_return = goal_return.double() + weights.double() @ term_returns.double().T
            order = total_return.argsort(dim=1, descending=True, stable=True)
            rank = order.argsort(dim=1)[:, candidates] + 1
            shift = (initial_rank - rank) * (rank > num_candidates)
            return shift.square().sum(dim=1) / 100.0**2

        return objective


@pytest.fixture(autouse=True)
def _one_thread() -> Iterator[None]:
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(threads)


def trajectories(kind: str) -> tuple[Tensor, Tensor]:
    """Goal returns [4096] in [0, 1] and penalties [4096, 7]."""
    generator = torch.Generator().manual_seed(0)
    goal_return = torch.rand(NUM_ENVS, generator=generator)
    penalties = -torch.rand(NUM_ENVS, NUM_TERMS, generator=generator)
    return goal_return, penalties * PENALTY_SCALE[kind]


def optimizer(objective: Objective) -> GreyWolfOptimizer:
    return configured("gwo", NUM_TERMS, objective, seed=0)


@pytest.mark.parametrize("kind", PENALTY_SCALE)
def test_weight_search(benchmark: BenchmarkFixture, kind: str) -> None:
    goal_return, term_returns = trajectories(kind)
    plain = optimizer(PlainRankDeviation())
    started = time.perf_counter()
    expected = plain.update(goal_return, term_returns)
    plain_s = time.perf_counter() - started

    found = benchmark.pedantic(
        lambda fast: fast.update(goal_return, term_returns),
        setup=lambda: ((optimizer(RankDeviation(0.1)),), {}),
        rounds=15,
        warmup_rounds=1,
    )
    assert benchmark.stats is not None
    found_s = statistics.median(benchmark.stats.stats.data)
    ratio = found_s / plain_s
    benchmark.extra_info["plain_sort_s"] = plain_s
    benchmark.extra_info["ratio_to_plain_sort"] = ratio
    print(f"\n{kind}: {found_s:.4f} s, {ratio:.2f} of the plain sort")
    assert torch.equal(found.weights, expected.weights)
    assert found.objective == expected.objective
    assert ratio <= LARGEST_RATIO
