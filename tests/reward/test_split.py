"""RewardSplit: which terms belong where, trajectory returns, and the composed reward."""

import pytest
import torch

from tlr_exp.errors import UserError
from tlr_exp.reward.split import RewardSplit

NAMES = ("body_pos", "body_rot", "base_height", "lin_vel_z")


@pytest.fixture
def split() -> RewardSplit:
    return RewardSplit(
        goal={"body_pos": 1.0, "body_rot": 0.5},
        optimizing={"base_height": -10.0, "lin_vel_z": -2.0},
        control_dt_s=0.5,
        term_names=NAMES,
    )


# One environment, two steps; terms body_pos, body_rot, base_height, lin_vel_z.
RAW = torch.tensor([[[1.0, 2.0, 0.5, 1.0], [0.0, 4.0, 1.0, 3.0]]])


def test_each_layer_has_its_names_in_the_order_given(split: RewardSplit) -> None:
    assert split.goal_names == ("body_pos", "body_rot")
    assert split.optimizing_names == ("base_height", "lin_vel_z")
    assert split.term_names == NAMES


def test_terms_are_found_by_name_wherever_they_are_recorded(split: RewardSplit) -> None:
    """Another order, and a term between them that neither layer has."""
    names = ("lin_vel_z", "body_rot", "torques", "base_height", "body_pos")
    other = RewardSplit(
        goal={"body_pos": 1.0, "body_rot": 0.5},
        optimizing={"base_height": -10.0, "lin_vel_z": -2.0},
        control_dt_s=0.5,
        term_names=names,
    )
    raw = torch.full((1, 2, 5), 1e3)
    for column, name in enumerate(NAMES):
        raw[..., names.index(name)] = RAW[..., column]
    for found, expected in zip(other.returns(raw), split.returns(RAW), strict=True):
        torch.testing.assert_close(found, expected)
    weights = torch.tensor([0.2, 1.0])
    torch.testing.assert_close(other.compose(raw, weights), split.compose(RAW, weights))
    means = dict(zip(NAMES, (0.5, 1.0, 2.0, 3.0), strict=True))
    assert other.layers(means) == split.layers(means) == (1.0, 26.0)


def test_returns_by_hand(split: RewardSplit) -> None:
    # goal: 0.5 s * (1.0 * (1 + 0) + 0.5 * (2 + 4)) = 0.5 * 4 = 2
    # base_height: 0.5 s * -10 * (0.5 + 1.0) = -7.5;  lin_vel_z: 0.5 s * -2 * (1 + 3) = -4
    goal_return, term_returns = split.returns(RAW)
    assert goal_return.tolist() == [2.0]
    assert term_returns.tolist() == [[-7.5, -4.0]]


def test_compose_by_hand(split: RewardSplit) -> None:
    # Weights (0.2, 1):
    # step 1: 0.5 * (1 * 1 + 0.5 * 2 + 0.2 * -10 * 0.5 + 1 * -2 * 1) = 0.5 * (2 - 1 - 2) = -0.5
    # step 2: 0.5 * (1 * 0 + 0.5 * 4 + 0.2 * -10 * 1.0 + 1 * -2 * 3) = 0.5 * (2 - 2 - 6) = -3.0
    reward = split.compose(RAW, torch.tensor([0.2, 1.0]))
    assert reward.shape == (1, 2, 1)
    torch.testing.assert_close(reward[0, :, 0], torch.tensor([-0.5, -3.0]))


def test_rewards_apart_by_hand_and_as_they_are_composed(split: RewardSplit) -> None:
    # 0.5 s times: goal 1 * 1 + 0.5 * 2 and 0.5 * 4; costs -10 * 0.5, -10 * 1 and -2 * 1, -2 * 3.
    apart = split.rewards_apart(RAW)
    assert apart.tolist() == [[[1.0, -2.5, -1.0], [1.0, -5.0, -3.0]]]
    weights = torch.tensor([0.2, 1.0])
    composed = apart[..., :1] + (apart[..., 1:] @ weights)[..., None]
    torch.testing.assert_close(composed, split.compose(RAW, weights))


def test_the_composed_reward_sums_to_the_total_return(split: RewardSplit) -> None:
    generator = torch.Generator().manual_seed(0)
    raw = torch.rand(5, 24, 4, generator=generator, dtype=torch.float64)
    weights = torch.rand(2, generator=generator, dtype=torch.float64)
    goal_return, term_returns = split.returns(raw)
    assert goal_return.shape == (5,)
    assert term_returns.shape == (5, 2)
    torch.testing.assert_close(
        split.compose(raw, weights).sum(dim=(1, 2)), goal_return + term_returns @ weights
    )


def test_weight_zero_removes_a_term_and_leaves_the_goal(split: RewardSplit) -> None:
    changed = RAW.clone()
    changed[..., 2:] = 100.0
    zero = torch.zeros(2)
    assert torch.equal(split.compose(RAW, zero), split.compose(changed, zero))
    # Goal alone: 0.5 * (1 + 0.5 * 2) = 1 and 0.5 * (0 + 0.5 * 4) = 1.
    assert split.compose(RAW, zero).flatten().tolist() == [1.0, 1.0]


def test_results_follow_the_dtype_of_the_terms(split: RewardSplit) -> None:
    weights = torch.tensor([0.2, 1.0], dtype=torch.float64)
    for dtype in (torch.float32, torch.float64, torch.float32):
        goal_return, term_returns = split.returns(RAW.to(dtype))
        assert goal_return.dtype == term_returns.dtype == dtype
        assert split.compose(RAW.to(dtype), weights).dtype == dtype


def test_composing_changes_neither_the_terms_nor_later_results(split: RewardSplit) -> None:
    raw = RAW.clone()
    before = split.returns(raw)
    split.compose(raw, torch.tensor([0.0, 0.3]))
    assert torch.equal(raw, RAW)
    assert all(torch.equal(a, b) for a, b in zip(before, split.returns(raw), strict=True))


def test_a_goal_alone_needs_no_weights() -> None:
    split = RewardSplit({"body_pos": 2.0}, {}, 0.02, ["body_pos"])
    raw = torch.ones(3, 4, 1)
    goal_return, term_returns = split.returns(raw)
    torch.testing.assert_close(goal_return, torch.full((3,), 4 * 0.02 * 2.0))
    assert term_returns.shape == (3, 0)
    torch.testing.assert_close(split.compose(raw, torch.ones(0)), torch.full((3, 4, 1), 0.04))


def test_terms_that_nothing_records_are_refused_with_those_that_are() -> None:
    with pytest.raises(UserError, match=r"body_poss.*goal") as error:
        RewardSplit({"body_poss": 1.0}, {}, 0.02, NAMES)
    assert all(name in str(error.value) for name in NAMES)
    with pytest.raises(UserError, match=r"heigth.*optimizing"):
        RewardSplit({"body_pos": 1.0}, {"heigth": -1.0}, 0.02, NAMES)


def test_a_term_in_both_groups_is_refused() -> None:
    with pytest.raises(ValueError, match=r"\['body_pos'\].*both groups"):
        RewardSplit({"body_pos": 1.0}, {"body_pos": 1.0}, 0.02, NAMES)


def test_an_empty_goal_is_refused() -> None:
    with pytest.raises(ValueError, match=r"'goal' is empty"):
        RewardSplit({}, {"base_height": -10.0}, 0.02, NAMES)


@pytest.mark.parametrize("value", [float("nan"), float("inf"), "1e-6", None, True])
def test_coefficients_that_are_no_finite_number_are_refused(value: object) -> None:
    with pytest.raises(ValueError, match=r"optimizing\.torques must be a finite number"):
        RewardSplit({"body_pos": 1.0}, {"torques": value}, 0.02, ("body_pos", "torques"))  # pyright: ignore[reportArgumentType]


@pytest.mark.parametrize("control_dt_s", [0.0, -0.02, float("nan")])
def test_a_control_step_that_is_not_positive_is_refused(control_dt_s: float) -> None:
    with pytest.raises(ValueError, match="control_dt_s"):
        RewardSplit({"body_pos": 1.0}, {}, control_dt_s, NAMES)


def test_shapes_that_do_not_fit_are_refused(split: RewardSplit) -> None:
    with pytest.raises(ValueError, match=r"expected \[num_envs, num_steps, 4\].*lin_vel_z"):
        split.returns(torch.zeros(2, 3, 5))
    with pytest.raises(ValueError, match=r"shape \(3, 4\)"):
        split.returns(torch.zeros(3, 4))
    with pytest.raises(ValueError, match=r"weights have shape \(4,\), expected \(2,\)"):
        split.compose(RAW, torch.ones(4))
    with pytest.raises(ValueError, match="floating point"):
        split.returns(torch.zeros(2, 3, 4, dtype=torch.int64))
