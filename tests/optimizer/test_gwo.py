"""The grey wolf search: its own properties, and parity with mealpy's original GWO."""

import math
import statistics
from collections.abc import Callable
from typing import Any

import pytest
import torch
from configured import make
from landscapes import (
    Recorder,
    box,
    constant,
    plateau,
    rastrigin,
    shifted_rastrigin,
    shifted_sphere,
    sphere,
)
from mealpy import FloatVar
from mealpy.swarm_based.GWO import OriginalGWO
from torch import Tensor

from tlr_exp.optimizer.gwo import GreyWolfOptimizer, grey_wolf_search
from tlr_exp.optimizer.search import SearchResult
from tlr_exp.reward.objectives import RankDeviation

DIMS = 6
PACK_SIZE = 30
ITERATIONS = 50


def search(
    function: Callable[[Tensor], Tensor],
    seed: int = 0,
    lower: float = -5.0,
    upper: float = 5.0,
    pack_size: int = PACK_SIZE,
    iterations: int = ITERATIONS,
    **settings: Any,
) -> SearchResult:
    task = box(lower, upper, DIMS, seed, **settings)
    return grey_wolf_search(function, task, pack_size=pack_size, iterations=iterations)


def mealpy_search(function: Callable[[Any], Any], seed: int) -> float:
    model = OriginalGWO(epoch=ITERATIONS, pop_size=PACK_SIZE)
    problem = {
        "bounds": FloatVar(lb=(-5.0,) * DIMS, ub=(5.0,) * DIMS),
        "minmax": "min",
        "obj_func": function,
        "log_to": None,
    }
    return model.solve(problem, seed=seed).target.fitness


@pytest.mark.parametrize("function", [sphere, shifted_sphere, rastrigin, shifted_rastrigin])
def test_reaches_what_mealpy_reaches_with_the_same_budget(
    function: Callable[[Any], Any],
) -> None:
    # Both evaluate 30 wolves at the start and after each of 50 moves. The values span orders of
    # magnitude, so their logarithms are compared: our mean over ten seeds must not be worse than
    # mealpy's by more than the standard deviation of mealpy's ten.
    theirs = [math.log(mealpy_search(function, seed)) for seed in range(10)]
    ours = [math.log(search(function, seed).value) for seed in range(10)]
    assert statistics.mean(ours) <= statistics.mean(theirs) + statistics.stdev(theirs)
    assert min(theirs) <= statistics.median(ours) <= max(theirs)


def test_every_position_lies_in_the_box() -> None:
    # The minimum is at a corner, so that moves beyond the box are common.
    recorder = Recorder(lambda x: -x.sum(-1))
    result = search(recorder, lower=0.25, upper=0.75)
    positions = torch.cat(recorder.packs)
    assert ((positions >= 0.25) & (positions <= 0.75)).all()
    assert (positions == 0.75).any()
    assert result.position.tolist() == [0.75] * DIMS


def test_the_budget_is_what_is_reported() -> None:
    recorder = Recorder(sphere)
    result = search(recorder, pack_size=7, iterations=11)
    assert [len(pack) for pack in recorder.packs] == [7] * 12
    assert result.evaluations == 7 * 12
    assert torch.equal(result.pack_values, recorder.values[-1])


@pytest.mark.parametrize("tie_break", ["first", "largest_norm"])
def test_leaders_persist_so_the_best_is_never_lost(tie_break: str) -> None:
    recorder = Recorder(shifted_rastrigin)
    result = search(recorder, tie_break=tie_break)
    best_of_each_pack = torch.stack([values.min() for values in recorder.values])
    assert (best_of_each_pack.diff() > 0).any()  # the pack itself does lose its best
    assert result.value == best_of_each_pack.min().item()
    assert shifted_rastrigin(result.position).item() == result.value


def test_one_move_by_hand() -> None:
    # In the first move a = 2. The random numbers come as r1, then r2, [leader, wolf, dim] each,
    # after those of the pack. In one dimension with the identity as function, the pack of four
    # sorted by value is its own list of leaders: alpha, beta, delta are the smallest three.
    generator = torch.Generator().manual_seed(5)
    pack = torch.rand(4, 1, generator=generator, dtype=torch.float64)
    r1, r2 = torch.rand(2, 3, 4, 1, generator=generator, dtype=torch.float64)
    leaders = pack.flatten().sort().values[:3]
    expected = []
    for wolf in range(4):
        moved = 0.0
        for k in range(3):
            a_coefficient = 2 * 2.0 * r1[k, wolf, 0].item() - 2.0
            c_coefficient = 2 * r2[k, wolf, 0].item()
            x_k, x = leaders[k].item(), pack[wolf, 0].item()
            moved += (x_k - a_coefficient * abs(c_coefficient * x_k - x)) / 3
        expected.append(min(max(moved, 0.0), 1.0))

    recorder = Recorder(lambda x: x[:, 0])
    grey_wolf_search(recorder, box(0.0, 1.0, 1, seed=5), pack_size=4, iterations=1)
    assert torch.equal(recorder.packs[0], pack)
    torch.testing.assert_close(recorder.packs[1].flatten().tolist(), expected)


def test_tie_break_first_keeps_what_was_found_first() -> None:
    recorder = Recorder(plateau)
    result = search(recorder, lower=0.0, upper=1.0)
    values, positions = torch.cat(recorder.values), torch.cat(recorder.packs)
    first = int((values == 0).nonzero()[0])
    assert torch.equal(result.position, positions[first])


def test_a_plateau_does_not_drag_the_weights_to_zero() -> None:
    # Everything is equally good: the first wolf of the random pack stays the leader.
    recorder = Recorder(constant)
    result = search(recorder, lower=0.0, upper=1.0)
    assert torch.equal(result.position, recorder.packs[0][0])
    assert result.optimal_share == 1.0
    # The last pack has gathered between the first three wolves, not at the origin.
    leaders = recorder.packs[0][:3]
    torch.testing.assert_close(
        recorder.packs[-1].mean(dim=0), leaders.mean(dim=0), atol=0.05, rtol=0.0
    )


def test_tie_break_largest_norm_takes_the_most_shaping() -> None:
    recorder = Recorder(plateau)
    result = search(recorder, lower=0.0, upper=1.0, tie_break="largest_norm")
    values, positions = torch.cat(recorder.values), torch.cat(recorder.packs)
    largest = positions[values == 0].norm(dim=1).max()
    assert result.value == 0.0
    assert result.position.norm() == largest
    assert largest > search(plateau, lower=0.0, upper=1.0).position.norm()


def test_the_tie_break_decides_among_equals_only() -> None:
    # Without ties the two settings are the same search.
    one, other = (search(sphere, tie_break=choice) for choice in ("first", "largest_norm"))
    assert torch.equal(one.position, other.position)


def test_optimal_share_counts_the_last_pack() -> None:
    recorder = Recorder(plateau)
    result = search(recorder, lower=0.0, upper=1.0, pack_size=8, iterations=2)
    at_optimum = [value == 0.0 for value in recorder.values[-1].tolist()]
    assert result.optimal_share == sum(at_optimum) / 8
    assert 0 < sum(at_optimum) < 8


def test_the_same_generator_state_gives_the_same_search() -> None:
    assert torch.equal(search(rastrigin, 1).position, search(rastrigin, 1).position)
    assert not torch.equal(search(rastrigin, 1).position, search(rastrigin, 2).position)


def test_start_positions_replace_the_first_wolves() -> None:
    start = torch.tensor([[1.0] * DIMS, [9.0] * DIMS])
    recorder = Recorder(sphere)
    search(recorder, start=start)
    assert recorder.packs[0][0].tolist() == [1.0] * DIMS
    assert recorder.packs[0][1].tolist() == [5.0] * DIMS  # clipped to the box
    without = Recorder(sphere)
    search(without)
    assert torch.equal(recorder.packs[0][2:], without.packs[0][2:])


def test_warm_start_begins_at_the_last_weights() -> None:
    # Nothing moves in the ranking at any weight, so the first wolf of the pack is returned.
    goal_return, term_returns = torch.arange(20.0), torch.zeros(20, 3)
    warm = make("gwo", num_terms=3, warm_start=True)
    assert warm.update(goal_return, term_returns).weights.tolist() == [1.0, 1.0, 1.0]
    warm.last_weights = torch.tensor([0.1, 0.2, 0.3])
    for _ in range(2):
        update = warm.update(goal_return, term_returns)
        torch.testing.assert_close(update.weights, torch.tensor([0.1, 0.2, 0.3]))
    cold = make("gwo", num_terms=3)
    first, second = (cold.update(goal_return, term_returns).weights for _ in range(2))
    assert not torch.equal(first, second)


def test_the_search_lowers_the_paper_objective() -> None:
    generator = torch.Generator().manual_seed(0)
    goal_return = torch.rand(500, generator=generator)
    # The first term turns the ranking round, the second restores it: the less of the first, the
    # better, so the best weights have it at its lower bound.
    term_returns = torch.stack([-2.0 * goal_return, goal_return], dim=1)
    term_returns[:, 0] += 0.3 * torch.rand(500, generator=generator)
    optimizer = make("gwo", num_terms=2, lower=0.2)
    update = optimizer.update(goal_return, term_returns)
    assert update.objective < 0.01 * update.baseline_objective
    assert update.evaluations == 30 * 51
    assert update.weights[0].item() == pytest.approx(0.2)


def test_a_persistent_pack_lives_on() -> None:
    persistent = make("gwo", num_terms=DIMS, persistent=True)
    passing = make("gwo", num_terms=DIMS)
    first, second = Recorder(shifted_sphere), Recorder(shifted_sphere)
    found = persistent.search(first)
    assert torch.equal(found.position, passing.search(shifted_sphere).position)  # nothing to keep
    persistent.search(second)
    start = second.packs[0]
    assert torch.equal(start[0], found.position)
    assert torch.equal(start[1:], first.packs[-1][1:])
    assert second.values[-1].mean() < first.values[0].mean()


def test_a_persistent_pack_of_another_size_is_refused() -> None:
    saved = make("gwo", num_terms=3, persistent=True, pack_size=10)
    saved.search(plateau)
    with pytest.raises(ValueError, match=r"shape \(10, 3\), this optimizer's is \(30, 3\)"):
        make("gwo", num_terms=3, persistent=True).load_state_dict(saved.state_dict())


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"persistent": 2}, "persistent is 2; allowed: true or false"),
        ({"pack_size": 2}, "pack_size is 2; allowed: at least 3"),
        ({"pack_size": "many"}, "pack_size is 'many'; allowed: a whole number"),
        ({"pack_size": 30.5}, "pack_size is 30.5; allowed: a whole number"),
        ({"iterations": 0}, "iterations is 0; allowed: at least 1"),
        ({"tie_break": "last"}, "tie_break is 'last'; allowed: first, largest_norm"),
        ({"warm_start": "yes"}, "warm_start is 'yes'; allowed: true or false"),
    ],
)
def test_bad_settings_are_refused(settings: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        make("gwo", **settings)


def test_runs_of_the_first_version_do_not_say_whether_the_pack_lives_on() -> None:
    box_of_it = {"lower": 0.0, "upper": 1.0, "tie_break": "first", "warm_start": False}
    given = {"num_terms": 3, "objective": RankDeviation(0.1), "seed": 0, "device": "cpu"}
    made = GreyWolfOptimizer(pack_size=30, iterations=50, **box_of_it, **given)
    assert set(made.state_dict()) == {"generator", "last_weights"}


def test_a_value_that_is_not_a_number_stops_the_search() -> None:
    with pytest.raises(ValueError, match="not a number"):
        search(lambda x: constant(x) * math.nan)
