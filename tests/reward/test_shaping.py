"""Costs as potentials: differences by hand, the telescoping sum, and a small MDP solved exactly."""

import torch
from torch import Tensor

from tlr_exp.reward.shaping import Shaping
from tlr_exp.reward.split import RewardSplit

NAMES = ("body_pos", "base_height")
GAMMA = 0.9
SHAPING = Shaping(["base_height"], NAMES, GAMMA)


def test_a_potential_is_a_difference_and_other_terms_stay_as_they_are():
    terms = torch.tensor([[0.5, 3.0], [0.25, 4.0]])
    shaped = SHAPING(terms, torch.tensor([[2.0], [5.0]]), torch.tensor([False, True]))
    # 0.9 * 3 - 2; at the failure 0.9 * 0 - 5.
    torch.testing.assert_close(shaped, torch.tensor([[0.5, 0.7], [0.25, -5.0]]))
    assert terms.tolist() == [[0.5, 3.0], [0.25, 4.0]]


def test_potentials_keep_their_own_order():
    shaping = Shaping(["b", "a"], ["a", "goal", "b"], 1.0)
    before = torch.tensor([[10.0, 20.0]])  # of b, of a
    shaped = shaping(torch.tensor([[1.0, 2.0, 3.0]]), before, torch.tensor([False]))
    assert shaped.tolist() == [[1.0 - 20.0, 2.0, 3.0 - 10.0]]


def discounted_sum(costs: Tensor, terminated: bool) -> float:
    """Of the differences along an episode through states with these costs [num_steps + 1]."""
    num_steps = len(costs) - 1
    terms = torch.stack([torch.zeros(num_steps), costs[1:]], dim=-1)
    failed = torch.zeros(num_steps, dtype=torch.bool)
    failed[-1] = terminated
    shaped = SHAPING(terms, costs[:-1, None], failed)[:, 1]
    return float((shaped * GAMMA ** torch.arange(num_steps)).sum())


def test_the_discounted_sum_telescopes_to_the_first_potential_alone():
    generator = torch.Generator().manual_seed(0)
    for num_steps in (1, 2, 30):
        costs = torch.rand(num_steps + 1, generator=generator)
        assert abs(discounted_sum(costs, terminated=True) + costs[0].item()) < 1e-5
        # Cut off, the episode goes on in the critic's value, which stands for the rest of the sum.
        rest = GAMMA**num_steps * costs[-1].item()
        assert abs(discounted_sum(costs, terminated=False) - rest + costs[0].item()) < 1e-5


STATES, ACTIONS = 6, 3  # the last state is a failure


def solved(reward: Tensor, chances: Tensor) -> Tensor:
    """Q* [STATES - 1, ACTIONS] by value iteration; both arguments [STATES - 1, ACTIONS, STATES]."""
    values = torch.zeros(STATES, dtype=torch.float64)
    for _ in range(500):
        quality = (chances * (reward + GAMMA * values)).sum(dim=-1)
        values[:-1] = quality.max(dim=1).values
    return quality


def test_the_optimal_policy_of_a_small_mdp_is_that_of_the_goal_alone():
    generator = torch.Generator().manual_seed(3)
    shape = (STATES - 1, ACTIONS, STATES)
    chances = torch.rand(shape, generator=generator).double().pow(3)
    chances /= chances.sum(dim=-1, keepdim=True)
    goal = torch.rand(shape, generator=generator).double()
    costs = torch.rand(STATES, generator=generator).double()
    terms = torch.stack([goal, costs.expand(shape)], dim=-1).reshape(-1, 1, 2)
    before = costs[:-1, None, None, None].expand(*shape, 1).reshape(-1, 1, 1)
    failed = (torch.arange(STATES) == STATES - 1).expand(shape).reshape(-1, 1)
    split = RewardSplit({"body_pos": 1.0}, {"base_height": -50.0}, 0.02, NAMES)
    weight = torch.tensor([0.8], dtype=torch.float64)

    def quality(raw: Tensor, weights: Tensor) -> Tensor:
        return solved(split.compose(raw, weights).reshape(shape), chances)

    alone = quality(terms, 0.0 * weight)
    shaped = quality(SHAPING(terms, before, failed), weight)
    potential = -50.0 * 0.02 * 0.8 * costs[:-1]
    torch.testing.assert_close(shaped, alone - potential[:, None])
    assert torch.equal(shaped.argmax(dim=1), alone.argmax(dim=1))
    # As a penalty the same cost changes what is best.
    assert not torch.equal(quality(terms, weight).argmax(dim=1), alone.argmax(dim=1))
