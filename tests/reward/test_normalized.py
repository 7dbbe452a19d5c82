"""Terms that vary alike: by hand, and what the weights found on them do not depend on."""

import pytest
import torch

from tlr_exp.reward.normalized import NormalizedTerms, equally_spread
from tlr_exp.reward.objectives import NonFiniteReturnsError, RankDeviation
from tlr_exp.reward.rank_agreement import KendallDistance


def test_every_term_that_varies_gets_the_spread_of_the_goal():
    goal = torch.tensor([0.0, 2.0])  # standard deviation 1
    terms = torch.tensor([[-0.5, -1e-4, 7.0], [-1.0, -3e-4, 7.0]])  # 0.25, 1e-4 and 0
    found = equally_spread(goal, terms)
    expected = torch.tensor([[-2.0, -1.0, 7.0], [-4.0, -3.0, 7.0]]).double()
    torch.testing.assert_close(found, expected, rtol=1e-6, atol=0.0)


def random_returns(num_envs=50, num_terms=3):
    generator = torch.Generator().manual_seed(0)
    goal = torch.rand(num_envs, generator=generator)
    return goal, -torch.rand(num_envs, num_terms, generator=generator)


PACK = torch.rand(20, 3, generator=torch.Generator().manual_seed(1))


@pytest.mark.parametrize("inner", [RankDeviation(0.1), KendallDistance()])
def test_j_does_not_change_with_the_coefficients(inner):
    goal, terms = random_returns()
    objective = NormalizedTerms(inner)
    values = objective.prepare(goal, terms)(PACK)
    scaled = objective.prepare(goal, terms * torch.tensor([0.125, 8.0, 1024.0]))(PACK)
    assert torch.equal(scaled, values)
    assert not torch.equal(inner.prepare(goal, terms * 1024.0)(PACK), values)


def test_the_order_of_the_environments_does_not_matter_and_j_of_no_lower_layer_is_0():
    goal, terms = random_returns()
    objective = NormalizedTerms(RankDeviation(0.1))
    order = torch.randperm(len(goal), generator=torch.Generator().manual_seed(2))
    values = objective.prepare(goal, terms)(PACK)
    assert torch.equal(objective.prepare(goal[order], terms[order])(PACK), values)
    assert objective.prepare(goal, terms)(torch.zeros(1, 3)).item() == 0.0


def test_terms_that_never_vary_are_left_alone():
    goal, terms = random_returns()
    flat = torch.full_like(terms, -0.1)
    assert torch.equal(equally_spread(goal, flat), flat.double())
    assert equally_spread(goal, terms[:, :0]).shape == (50, 0)


def test_returns_that_are_not_finite_are_told_as_ever():
    goal, terms = random_returns()
    terms[3, 1] = torch.nan
    with pytest.raises(NonFiniteReturnsError, match="1 of 50 environments, the first of them 3"):
        NormalizedTerms(RankDeviation(0.1)).prepare(goal, terms)
