"""J(w) of the paper: hand arithmetic, an independent sort, and the properties it must have."""

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from tlr_exp.reward.objectives import (
    RankDeviation,
    RetainedShare,
    _shifts_by_full_sort,
    retained_counts,
    squared_shifts_,
)

# Six trajectories A..F and two terms. With the share 0.34, K = floor(2.04) = 2: the candidates
# are A (N_ini = 1) and B (N_ini = 2).
GOAL_RETURN = torch.tensor([10.0, 9.0, 8.0, 7.0, 6.0, 5.0])
TERM_RETURNS = torch.tensor(
    [[-4.0, 0.0], [0.0, -6.0], [0.0, 0.0], [-0.5, 0.0], [0.0, -0.5], [0.0, -1.0]]
)


@pytest.mark.parametrize(
    ("weights", "expected"),
    [
        # r_t = 10, 9, 8, 7, 6, 5: nothing moves.
        ([0.0, 0.0], 0.0),
        # r_t = 6, 3, 8, 6.5, 5.5, 4; order C D A E F B; A falls to 3 and B to 6:
        # ((1 - 3) / 100)^2 + ((2 - 6) / 100)^2 = (4 + 16) / 10000
        ([1.0, 1.0], 0.0020),
        # r_t = 6, 9, 8, 6.5, 6, 5; order B C D A E F, as A is before E at equal r_t; B rises to
        # 1, which is not above K; A falls to 4: ((1 - 4) / 100)^2
        ([1.0, 0.0], 0.0009),
        # r_t = 10, 3, 8, 7, 5.5, 4; order A C D E F B; B falls to 6: ((2 - 6) / 100)^2
        ([0.0, 1.0], 0.0016),
        # r_t = 8, 9, 8, ...: B, then A before C at equal r_t; both stay within K = 2.
        ([0.5, 0.0], 0.0),
        # r_t = 7.6, 9, 8, 6.7, 6, 5; order B C A: A falls to 3, ((1 - 3) / 100)^2
        ([0.6, 0.0], 0.0004),
    ],
)
def test_six_trajectories_by_hand(weights: list[float], expected: float) -> None:
    objective = RankDeviation(threshold_share=0.34).prepare(GOAL_RETURN, TERM_RETURNS)
    assert objective(torch.tensor([weights])).tolist() == [expected]


def test_a_pack_is_its_rows_one_by_one() -> None:
    objective = RankDeviation(threshold_share=0.34).prepare(GOAL_RETURN, TERM_RETURNS)
    pack = torch.tensor([[1.0, 1.0], [0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
    assert objective(pack).tolist() == [0.0020, 0.0, 0.0009, 0.0016]
    assert objective(pack[:3]).tolist() == [0.0020, 0.0, 0.0009]  # another size of pack
    assert objective(pack.flip(0)).tolist() == [0.0016, 0.0009, 0.0, 0.0020]


def naive_objective(
    goal: list[float], terms: list[list[float]], weights: list[float], num_candidates: int
) -> float:
    """J by Python's sort, one trajectory and one weight at a time."""
    environments = range(len(goal))
    at_first = sorted(environments, key=lambda e: (-goal[e], [-value for value in terms[e]]))
    total = [
        goal[e] + sum(w * v for w, v in zip(weights, terms[e], strict=True)) for e in environments
    ]
    afterwards = sorted(environments, key=lambda e: (-total[e], at_first.index(e)))
    squares = 0
    for initial_rank, e in enumerate(at_first[:num_candidates], start=1):
        final_rank = afterwards.index(e) + 1
        if final_rank > num_candidates:
            squares += (initial_rank - final_rank) ** 2
    return squares / 100**2


@st.composite
def trajectories(draw: st.DrawFn) -> tuple[list[float], list[list[float]], list[list[float]]]:
    """Few distinct values, so that ties abound; quarters, so that every sum is exact."""
    num_envs = draw(st.integers(10, 40))
    num_terms = draw(st.integers(1, 4))
    quarters = st.integers(-6, 6).map(lambda value: value / 4)
    weight = st.integers(0, 4).map(lambda value: value / 4)
    goal = draw(st.lists(quarters, min_size=num_envs, max_size=num_envs))
    row = st.lists(quarters, min_size=num_terms, max_size=num_terms)
    terms = draw(st.lists(row, min_size=num_envs, max_size=num_envs))
    pack = draw(
        st.lists(st.lists(weight, min_size=num_terms, max_size=num_terms), min_size=1, max_size=4)
    )
    return goal, terms, pack


SHARES = st.sampled_from([0.1, 0.25, 0.34, 0.5, 0.9])


@settings(deadline=None, max_examples=150)
@given(case=trajectories(), share=SHARES)
def test_equals_a_naive_sort_where_ties_abound(case, share: float) -> None:
    goal, terms, pack = case
    deviation = RankDeviation(share)
    num_candidates = deviation.num_candidates(len(goal))
    objective = deviation.prepare(torch.tensor(goal), torch.tensor(terms))
    expected = [naive_objective(goal, terms, weights, num_candidates) for weights in pack]
    assert objective(torch.tensor(pack)).tolist() == expected


@pytest.mark.parametrize("scale", [0.1, 0.3, 5.0])
def test_equals_a_naive_sort_on_continuous_values(scale: float) -> None:
    rng = np.random.default_rng(7)
    goal = rng.normal(size=300)
    terms = -scale * rng.random(size=(300, 7))
    pack = rng.random(size=(6, 7))
    objective = RankDeviation(0.1).prepare(torch.from_numpy(goal), torch.from_numpy(terms))
    expected = [naive_objective(list(goal), terms.tolist(), list(w), 30) for w in pack]
    assert any(expected)
    assert objective(torch.from_numpy(pack)).tolist() == expected


@settings(deadline=None, max_examples=100)
@given(case=trajectories(), share=SHARES, seed=st.integers(0, 2**32 - 1))
def test_the_order_of_the_environments_does_not_matter_in_ties(
    case, share: float, seed: int
) -> None:
    goal, terms, pack = (torch.tensor(part) for part in case)
    shuffled = torch.randperm(len(goal), generator=torch.Generator().manual_seed(seed))
    deviation = RankDeviation(share)
    assert torch.equal(
        deviation.prepare(goal, terms)(pack),
        deviation.prepare(goal[shuffled], terms[shuffled])(pack),
    )


@settings(deadline=None, max_examples=30)
@given(seed=st.integers(0, 2**32 - 1))
def test_the_order_of_the_environments_does_not_matter_to_the_bit(seed: int) -> None:
    generator = torch.Generator().manual_seed(seed)
    goal = torch.randn(257, generator=generator)
    terms = -torch.rand(257, 7, generator=generator)
    terms[100:] = terms[100].clone()  # many trajectories that differ in the goal return alone
    goal[200:] = goal[200]  # and many that do not differ at all
    pack = torch.rand(5, 7, generator=generator)
    shuffled = torch.randperm(257, generator=generator)
    deviation = RankDeviation(0.1)
    assert torch.equal(
        deviation.prepare(goal, terms)(pack),
        deviation.prepare(goal[shuffled], terms[shuffled])(pack),
    )


@settings(deadline=None, max_examples=50)
@given(seed=st.integers(0, 2**32 - 1), share=SHARES, dtype=st.sampled_from(["float32", "float64"]))
def test_weights_zero_leave_every_rank(seed: int, share: float, dtype: str) -> None:
    generator = torch.Generator().manual_seed(seed)
    goal = torch.randn(101, generator=generator, dtype=getattr(torch, dtype))
    goal[50:] = goal[:51].clone()
    terms = 1e3 * torch.randn(101, 7, generator=generator, dtype=getattr(torch, dtype))
    objective = RankDeviation(share).prepare(goal, terms)
    assert objective(torch.zeros(2, 7)).tolist() == [0.0, 0.0]


def test_ranks_are_those_of_double_precision() -> None:
    # K = 1. In float32 the first two would tie; here the first falls to 2: ((1 - 2) / 100)^2.
    goal = torch.tensor([1.0, 1.0 - 1e-10] + [0.0] * 8, dtype=torch.float64)
    terms = torch.tensor([[-2e-10]] + [[0.0]] * 9, dtype=torch.float64)
    objective = RankDeviation(0.1).prepare(goal, terms)
    assert objective(torch.tensor([[1.0], [0.25]])).tolist() == [0.0001, 0.0]


def test_identical_trajectories_give_zero_at_every_weight() -> None:
    objective = RankDeviation(0.1).prepare(torch.full((50,), 1.1), torch.full((50, 3), -0.7))
    pack = torch.rand(8, 3, generator=torch.Generator().manual_seed(0))
    assert objective(pack).tolist() == [0.0] * 8


def test_minus_zero_is_zero() -> None:
    # All r_t are 0 or -0: equal, so the initial order stays, however the signs lie.
    goal = torch.tensor([-0.0, 0.0] * 10)
    objective = RankDeviation(0.1).prepare(goal, torch.zeros(20, 1))
    assert objective(torch.ones(1, 1)).tolist() == [0.0]


@settings(deadline=None, max_examples=100)
@given(case=trajectories(), share=SHARES)
def test_the_search_and_the_full_sort_agree(case, share: float) -> None:
    goal, terms, pack = (torch.tensor(part, dtype=torch.float64) for part in case)
    total_return = goal + pack @ terms.T
    num_candidates = RankDeviation(share).num_candidates(len(goal))
    by_sort = _shifts_by_full_sort(total_return, num_candidates)
    assert torch.equal(squared_shifts_(total_return.clone(), num_candidates), by_sort)


@pytest.mark.parametrize(
    ("weights", "expected"),
    [
        # The cases of the paper's J above: how many of A and B left the best two.
        ([0.0, 0.0], 0.0),
        ([1.0, 1.0], 1.0),  # order C D A E F B: both
        ([1.0, 0.0], 0.5),  # B C D A E F: A
        ([0.5, 0.0], 0.0),  # B A C, as A is before C at equal r_t
        ([0.6, 0.0], 0.5),  # B C A: A
    ],
)
def test_the_retained_share_by_hand(weights: list[float], expected: float) -> None:
    objective = RetainedShare(threshold_share=0.34).prepare(GOAL_RETURN, TERM_RETURNS)
    assert objective(torch.tensor([weights, weights])).tolist() == [expected, expected]


@settings(deadline=None, max_examples=150)
@given(case=trajectories(), share=SHARES)
def test_the_retained_share_equals_a_naive_count_where_ties_abound(case, share: float) -> None:
    goal, terms, pack = case
    objective = RetainedShare(share)
    num_candidates = objective.num_candidates(len(goal))
    at_first = sorted(range(len(goal)), key=lambda e: (-goal[e], [-value for value in terms[e]]))
    expected = []
    for weights in [[0.0] * len(pack[0]), *pack]:
        total = [
            goal[e] + sum(w * v for w, v in zip(weights, terms[e], strict=True))
            for e in range(len(goal))
        ]
        after = sorted(range(len(goal)), key=lambda e: (-total[e], at_first.index(e)))
        lost = set(at_first[:num_candidates]) - set(after[:num_candidates])
        expected.append(len(lost) / num_candidates)
    function = objective.prepare(torch.tensor(goal), torch.tensor(terms))
    found = function(torch.tensor([[0.0] * len(pack[0]), *pack])).tolist()
    assert found[0] == 0.0
    assert found == pytest.approx(expected, abs=1e-15)


@pytest.mark.gpu
def test_an_accelerator_counts_the_same_candidates() -> None:
    generator = torch.Generator().manual_seed(3)
    total = (40 * torch.rand(5, 300, generator=generator)).round().double()
    assert torch.equal(retained_counts(total.cuda(), 30).cpu(), retained_counts(total, 30))


@pytest.mark.gpu
def test_an_accelerator_finds_the_same_values() -> None:
    generator = torch.Generator().manual_seed(3)
    goal = torch.randn(4096, generator=generator)
    terms = -torch.rand(4096, 7, generator=generator)
    pack = torch.rand(30, 7, generator=generator)
    expected = RankDeviation(0.1).prepare(goal, terms)(pack)
    found = RankDeviation(0.1).prepare(goal.cuda(), terms.cuda())(pack.cuda())
    assert found.device.type == "cuda"
    torch.testing.assert_close(found.cpu(), expected, rtol=1e-6, atol=0.0)


def test_returns_and_weights_stay_as_they_were() -> None:
    goal, terms = GOAL_RETURN.clone(), TERM_RETURNS.clone()
    pack = torch.tensor([[1.0, 1.0]])
    RankDeviation(0.34).prepare(goal, terms)(pack)
    assert torch.equal(goal, GOAL_RETURN)
    assert torch.equal(terms, TERM_RETURNS)
    assert pack.tolist() == [[1.0, 1.0]]


@pytest.mark.parametrize(
    ("share", "num_envs", "expected"),
    [(0.10, 4096, 409), (0.10, 10, 1), (0.29, 100, 29), (0.34, 6, 2), (0.999, 10, 9)],
)
def test_number_of_candidates(share: float, num_envs: int, expected: int) -> None:
    assert RankDeviation(share).num_candidates(num_envs) == expected


def test_a_larger_share_counts_more_candidates() -> None:
    # K = 3 (share 0.5): candidates A, B, C; at (1, 1) the order is C D A E F B: A is 3, not
    # above K; B falls to 6: ((2 - 6) / 100)^2.
    objective = RankDeviation(0.5).prepare(GOAL_RETURN, TERM_RETURNS)
    assert objective(torch.tensor([[1.0, 1.0]])).tolist() == [0.0016]


def test_too_few_environments_are_refused_with_what_would_do() -> None:
    with pytest.raises(ValueError, match=r"num_envs >= 10, or threshold_share >= 0\.166667"):
        RankDeviation(0.10).prepare(GOAL_RETURN, TERM_RETURNS)


@pytest.mark.parametrize("share", [0.0, 1.0, -0.1, 10, float("nan")])
def test_shares_outside_the_open_unit_interval_are_refused(share: float) -> None:
    with pytest.raises(ValueError, match=r"threshold_share is .*; allowed: above 0 and below 1"):
        RankDeviation(share)


def test_returns_that_are_not_finite_are_refused() -> None:
    goal = GOAL_RETURN.clone()
    goal[4] = float("nan")
    with pytest.raises(ValueError, match=r"goal_return is not finite in 1 of 6 .* them 4"):
        RankDeviation(0.34).prepare(goal, TERM_RETURNS)
    terms = TERM_RETURNS.clone()
    terms[2:4] = float("-inf")
    with pytest.raises(ValueError, match=r"term_returns is not finite in 2 of 6 .* them 2"):
        RankDeviation(0.34).prepare(GOAL_RETURN, terms)


def test_shapes_that_do_not_fit_are_refused() -> None:
    with pytest.raises(ValueError, match=r"got shapes \(6,\) and \(5, 2\)"):
        RankDeviation(0.34).prepare(GOAL_RETURN, TERM_RETURNS[:5])
