"""Ties, and the tally that every search keeps."""

import math

import pytest
import torch
from landscapes import Recorder, box, sphere

from tlr_exp.optimizer.search import BudgetSpent, Tally, best_first, improves

# Norms 1, 5, 5, 13; the second and the fourth are equally good.
POSITIONS = torch.tensor([[1.0, 0.0], [3.0, 4.0], [4.0, 3.0], [5.0, 12.0]])
VALUES = torch.tensor([2.0, 1.0, 3.0, 1.0])


def test_ties_are_broken_by_place_or_by_norm() -> None:
    assert best_first(POSITIONS, VALUES, "first").tolist() == [1, 3, 0, 2]
    assert best_first(POSITIONS, VALUES, "largest_norm").tolist() == [3, 1, 0, 2]
    equal = torch.zeros(4)
    assert best_first(POSITIONS, equal, "first").tolist() == [0, 1, 2, 3]
    assert best_first(POSITIONS, equal, "largest_norm").tolist() == [3, 1, 2, 0]


def test_only_a_larger_norm_improves_on_an_equal() -> None:
    old = POSITIONS[[1, 1, 1, 1]], torch.tensor([2.0, 1.0, 3.0, 1.0])
    assert improves(POSITIONS, VALUES, *old, "first").tolist() == [False] * 4
    assert improves(POSITIONS, VALUES, *old, "largest_norm").tolist() == [False, False, False, True]
    assert improves(POSITIONS, VALUES - 0.1, *old, "first").tolist() == [True] * 4
    assert improves(POSITIONS, VALUES + 0.1, *old, "largest_norm").tolist() == [False] * 4


def tally(recorder: Recorder, **settings) -> Tally:
    return Tally(recorder, box(-2.0, 2.0, 2), **settings)


def test_positions_are_clipped_and_counted_and_the_best_is_kept() -> None:
    recorder = Recorder(sphere)
    count = tally(recorder)
    assert count(POSITIONS).tolist() == [1.0, 8.0, 8.0, 8.0]
    assert count(torch.tensor([[1.0, 1.0], [0.0, -1.0]])).tolist() == [2.0, 1.0]
    assert recorder.packs[0].tolist() == [[1, 0], [2, 2], [2, 2], [2, 2]]
    result = count.result(recorder.packs[-1], recorder.values[-1])
    assert result.position.tolist() == [1.0, 0.0]  # found before the other of value 1
    assert (result.value, result.evaluations) == (1.0, 6)
    assert result.optimal_share == 0.5


def test_the_last_of_a_budget_goes_to_the_first_positions() -> None:
    recorder = Recorder(sphere)
    count = tally(recorder, budget=5)
    count(POSITIONS)
    with pytest.raises(BudgetSpent):
        count(torch.tensor([[0.5, 0.0], [0.0, 0.0]]))
    with pytest.raises(BudgetSpent):
        count(POSITIONS)
    assert (count.evaluations, recorder.calls) == (5, 5)
    assert count.best.tolist() == [[0.5, 0.0]]


def test_a_budget_may_end_with_a_batch() -> None:
    count = tally(Recorder(sphere), budget=4)
    assert len(count(POSITIONS)) == 4


def test_not_a_number_is_named_with_its_weights() -> None:
    count = tally(Recorder(lambda x: torch.where(x[:, 0] > 1, math.nan, x[:, 0])))
    with pytest.raises(ValueError, match=r"not a number at the weights \[2\.0, 2\.0\]"):
        count(POSITIONS)
