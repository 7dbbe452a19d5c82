"""Rank agreement over all trajectories: hand counts, parity with SciPy, properties."""

import itertools

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import kendalltau, spearmanr

from tlr_exp.reward.objectives import Objective
from tlr_exp.reward.rank_agreement import (
    KendallDistance,
    SpearmanDistance,
    descending_order,
    inversions,
    tied_pairs,
)

BOTH = [KendallDistance(), SpearmanDistance()]
IDS = ["kendall", "spearman"]
SCIPY = {KendallDistance: kendalltau, SpearmanDistance: spearmanr}

# Four trajectories and one term: at weight 1, r_t = 4 - 3, 3 - 0, 2 - 0, 1 - 0 = 1, 3, 2, 1.
GOAL_RETURN = torch.tensor([4.0, 3.0, 2.0, 1.0])
TERM_RETURNS = torch.tensor([[-3.0], [0.0], [0.0], [0.0]])


@pytest.mark.parametrize(
    ("weight", "kendall", "spearman"),
    [
        # r_t = 4, 3, 2, 1.
        (0.0, 0.0, 0.0),
        # r_t = 2.5, 3, 2, 1: of 6 pairs one is turned round: tau = (5 - 1) / 6. Ranks 2 1 3 4
        # against 1 2 3 4: rho = 1 - 6 (1 + 1) / (4 * 15).
        (0.5, 1 / 3, 0.2),
        # r_t = 1, 3, 2, 1: C = 3 (among the last three), D = 2 (the first against 3 and 2), one
        # tied pair: tau_b = (3 - 2) / sqrt(6 * 5). Ranks 3.5 1 2 3.5: centred 1, -1.5, -0.5, 1
        # against -1.5, -0.5, 0.5, 1.5: product 0.5, squares 4.5 and 5.
        (1.0, 1 - 1 / 30**0.5, 1 - 0.5 / (4.5 * 5) ** 0.5),
        # r_t = -2, 3, 2, 1: D = 3; tau = 0. Ranks 4 1 2 3: rho = 1 - 6 (9 + 1 + 1 + 1) / 60.
        (2.0, 1.0, 1.2),
    ],
)
def test_four_trajectories_by_hand(weight: float, kendall: float, spearman: float) -> None:
    for objective, expected in zip(BOTH, (kendall, spearman), strict=True):
        found = objective.prepare(GOAL_RETURN, TERM_RETURNS)(torch.tensor([[weight]]))
        assert found.tolist() == pytest.approx([expected], abs=1e-15)
        assert found.dtype == torch.float64


@pytest.mark.parametrize("objective", BOTH, ids=IDS)
def test_the_reverse_ranking_is_two_and_a_ranking_of_equals_one(objective: Objective) -> None:
    function = objective.prepare(GOAL_RETURN, -GOAL_RETURN[:, None])
    assert function(torch.tensor([[0.5], [1.0], [2.0]])).tolist() == [0.0, 1.0, 2.0]


@st.composite
def trajectories(draw: st.DrawFn) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    """Few distinct values, so that ties abound; quarters, so that every sum is exact."""
    num_envs, num_terms = draw(st.integers(2, 60)), draw(st.integers(1, 3))
    generator = torch.Generator().manual_seed(draw(st.integers(0, 2**32 - 1)))
    levels = draw(st.sampled_from([1, 2, 5, 1000]))

    def quarters(*shape: int) -> torch.Tensor:
        return torch.randint(-levels, levels + 1, shape, generator=generator) / 4.0

    return quarters(num_envs), quarters(num_envs, num_terms), quarters(3, num_terms)


@pytest.mark.parametrize("objective", BOTH, ids=IDS)
@settings(deadline=None, max_examples=60)
@given(case=trajectories())
def test_equals_scipy_with_and_without_ties(objective: Objective, case) -> None:
    goal, terms, pack = case
    found = objective.prepare(goal, terms)(pack).numpy()
    total = (goal + pack @ terms.T).double().numpy()
    for value, row in zip(found, total, strict=True):
        if len(np.unique(goal)) == 1:
            assert value == 0.0
        elif len(np.unique(row)) == 1:
            assert value == 1.0
        else:
            expected = 1.0 - SCIPY[type(objective)](goal.numpy(), row).statistic
            assert value == pytest.approx(expected, abs=1e-12)


@pytest.mark.parametrize("objective", BOTH, ids=IDS)
@settings(deadline=None, max_examples=60)
@given(case=trajectories(), seed=st.integers(0, 2**32 - 1))
def test_neither_the_order_of_the_environments_nor_weights_zero_change_a_rank(
    objective: Objective, case, seed: int
) -> None:
    goal, terms, pack = case
    pack[0] = 0.0
    shuffled = torch.randperm(len(goal), generator=torch.Generator().manual_seed(seed))
    found = objective.prepare(goal, terms)(pack)
    assert found[0] == 0.0
    assert torch.equal(found, objective.prepare(goal[shuffled], terms[shuffled])(pack))
    assert ((found >= 0.0) & (found <= 2.0)).all()


@pytest.mark.parametrize("objective", BOTH, ids=IDS)
@pytest.mark.parametrize("num_envs", [257, 4096])
def test_equals_scipy_on_continuous_returns(objective: Objective, num_envs: int) -> None:
    rng = np.random.default_rng(5)
    goal, terms = rng.normal(size=num_envs), -rng.random(size=(num_envs, 6))
    pack = rng.random(size=(4, 6))
    found = objective.prepare(torch.from_numpy(goal), torch.from_numpy(terms))
    expected = [1.0 - SCIPY[type(objective)](goal, goal + terms @ w).statistic for w in pack]
    assert found(torch.from_numpy(pack)).tolist() == pytest.approx(expected, abs=1e-12)
    assert found(torch.zeros(1, 6)).item() == 0.0


@settings(deadline=None, max_examples=40)
@given(n=st.integers(1, 70), rows=st.integers(1, 3), seed=st.integers(0, 2**32 - 1))
def test_inversions_are_the_pairs_in_the_wrong_order(n: int, rows: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    permutations = np.stack([rng.permutation(n) for _ in range(rows)])
    expected = [sum(a > b for a, b in itertools.combinations(row, 2)) for row in permutations]
    assert inversions(permutations).tolist() == expected


def test_inversions_of_the_reverse_are_all_pairs() -> None:
    assert inversions(np.arange(5000)[None, ::-1]).tolist() == [5000 * 4999 / 2]


def test_order_and_tied_pairs_by_hand() -> None:
    order, tied = descending_order(np.array([[2.0, 5.0, 2.0, 5.0, 5.0], [1.0, 2.0, 3.0, 4.0, 5.0]]))
    assert order.tolist() == [[1, 3, 4, 0, 2], [4, 3, 2, 1, 0]]
    assert tied_pairs(tied).tolist() == [3 + 1, 0]


@pytest.mark.parametrize("objective", BOTH, ids=IDS)
def test_what_cannot_be_ranked_is_refused(objective: Objective) -> None:
    with pytest.raises(ValueError, match="goal_return is not finite in 1 of 4"):
        objective.prepare(GOAL_RETURN / torch.tensor([1.0, 1.0, 1.0, 0.0]), TERM_RETURNS)
    with pytest.raises(ValueError, match=r"got shapes \(4,\) and \(3, 1\)"):
        objective.prepare(GOAL_RETURN, TERM_RETURNS[:3])


@pytest.mark.parametrize("objective", BOTH, ids=IDS)
def test_returns_and_weights_stay_as_they_were(objective: Objective) -> None:
    goal, terms, pack = GOAL_RETURN.clone(), TERM_RETURNS.clone(), torch.tensor([[1.0], [0.5]])
    objective.prepare(goal, terms)(pack)
    assert torch.equal(goal, GOAL_RETURN)
    assert torch.equal(terms, TERM_RETURNS)
    assert pack.tolist() == [[1.0], [0.5]]
