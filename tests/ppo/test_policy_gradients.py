"""Gradients of the policy reward by reward: advantages by hand, gradients by autograd and steps."""

import copy
import math

import pytest
import torch
from learners import collected, parameters_of, same
from torch import Tensor
from torch.nn.utils import parameters_to_vector, vector_to_parameters

from tlr_exp import keys
from tlr_exp.errors import UserError
from tlr_exp.ppo import policy_gradients
from tlr_exp.ppo.learner import Ppo
from tlr_exp.ppo.policy_gradients import BatchGradients, advantages_apart

STEP_SIZE = 0.5


def test_advantages_by_hand():
    # gamma lambda = 0.5; an episode of the first environment ends with its second step.
    # The first reward is 1, 2, 4 there and 0 in the second environment. With the cut the sums are
    # 1 + 0.5 * 2 = 2, 2, 4; less the mean over the environments: 1, 1, 2 and -1, -1, -2.
    # The second reward is the same in both, before the cut: sums 4, 8, 0 in both.
    # The third comes after it: sums 0, 0, 2 where the episode has ended, 0.5, 1, 2 in the other.
    first = torch.tensor([[1.0, 2.0, 4.0], [0.0, 0.0, 0.0]])
    second = torch.tensor([[0.0, 8.0, 0.0], [0.0, 8.0, 0.0]])
    third = torch.tensor([[0.0, 0.0, 2.0], [0.0, 0.0, 2.0]])
    done = torch.zeros(2, 3, 1, dtype=torch.bool)
    done[0, 1] = True
    rewards = torch.stack((first, second, third), dim=-1)
    found = advantages_apart(rewards, done, gamma=0.625, gae_lambda=0.8)
    deviation = math.sqrt(12 / 5)  # of the first: the squares are 2 (1 + 1 + 4)
    goal = torch.tensor([[1.0, 1.0, 2.0], [-1.0, -1.0, -2.0]])
    torch.testing.assert_close(found[..., 0], goal / deviation)
    assert (found[..., 1] == 0.0).all()
    late = torch.tensor([[-0.25, -0.5, 0.0], [0.25, 0.5, 0.0]])
    torch.testing.assert_close(found[..., 2], late / deviation)


def test_a_reward_counts_in_the_learners_advantages_as_it_does_apart(make_ppo):
    """The learner's at weights w less those at 0, whatever its critic: w . GAE(r_i, 0)."""
    ppo = make_ppo()
    batch, other = collected(ppo), collected(ppo, seed=1)
    term, goal = other["next", keys.REWARD], batch["next", keys.REWARD].clone()
    targets = []
    for weight in (0.0, 0.3):
        batch["next", keys.REWARD] = goal + weight * term
        ppo.estimate_advantages(batch)
        targets.append(batch["value_target"].clone())  # value plus advantage, not normalised
    done, gamma, decay = batch["next", keys.DONE], ppo.settings.gamma, ppo.settings.gae_lambda
    apart = advantages_apart(torch.cat((goal, term), dim=-1), done, gamma, decay)
    difference = (targets[1] - targets[0])[..., 0] / 0.3
    centred = difference - difference.mean(dim=0)
    # All are divided by one number.
    torch.testing.assert_close(apart[..., 1], centred * apart[..., 1].std() / centred.std())
    assert apart[..., 0].std().item() == pytest.approx(1.0, abs=1e-5)


@pytest.fixture
def ppo(make_ppo) -> Ppo:
    return make_ppo()


@pytest.fixture
def batch(ppo):
    return collected(ppo, num_envs=6, num_steps=4)


@pytest.fixture
def gradients(ppo, batch) -> BatchGradients:
    generator = torch.Generator().manual_seed(5)
    return ppo.policy_gradients(batch, torch.randn(6, 4, 3, generator=generator))


def surrogates(
    ppo: Ppo, batch, gradients: BatchGradients, step: Tensor | None = None
) -> tuple[Tensor, list[Tensor]]:
    """The objectives [num_rewards] of a copy of the actor, moved by a step; its parameters."""
    actor = copy.deepcopy(ppo.actor)
    if step is not None:
        moved = parameters_to_vector(actor.parameters()).detach() + step
        vector_to_parameters(moved, actor.parameters())
    log_prob = actor.get_dist(batch.select(keys.OBSERVATION)).log_prob(batch[keys.ACTION])
    ratio = (log_prob - batch["action_log_prob"]).exp()
    values = (ratio[..., None] * gradients.advantages).mean(dim=(0, 1))
    return values, list(actor.parameters())


def test_gradients_are_those_of_the_surrogate_objectives(ppo, batch, gradients):
    values, parameters = surrogates(ppo, batch, gradients)
    expected = [
        parameters_to_vector(torch.autograd.grad(value, parameters, retain_graph=True))
        for value in values
    ]
    torch.testing.assert_close(gradients.goal, expected[0])
    torch.testing.assert_close(gradients.terms, torch.stack(expected[1:]))


def test_the_goals_gradient_after_a_step_is_that_of_the_moved_policy(ppo, batch, gradients):
    step = STEP_SIZE * gradients.terms[0]
    values, parameters = surrogates(ppo, batch, gradients, step)
    expected = parameters_to_vector(torch.autograd.grad(values[0], parameters))
    found = gradients.goal_after(step)
    torch.testing.assert_close(found, expected)
    assert not torch.allclose(found, gradients.goal)


def test_the_derivative_through_a_step_is_that_of_finite_differences(ppo, batch, gradients):
    """d J(theta + s (g + w . g_i)) / d w_i = s grad J . g_i, with J computed by another actor."""
    weights = torch.tensor([0.25, 0.75])

    def gained(weights: Tensor) -> float:
        step = STEP_SIZE * (gradients.goal + weights @ gradients.terms)
        return surrogates(ppo, batch, gradients, step)[0][0].item()

    small = 0.02
    expected = [
        (gained(weights + small * unit) - gained(weights - small * unit)) / (2.0 * small)
        for unit in torch.eye(2)
    ]
    step = STEP_SIZE * (gradients.goal + weights @ gradients.terms)
    found = STEP_SIZE * gradients.terms @ gradients.goal_after(step)
    assert found.tolist() == pytest.approx(expected, rel=0.02, abs=1e-4)


def test_the_mean_of_both_halves_is_the_whole(gradients):
    one, other = gradients.halves()
    torch.testing.assert_close((one.goal + other.goal) / 2, gradients.goal)
    torch.testing.assert_close((one.terms + other.terms) / 2, gradients.terms)
    assert not torch.allclose(one.goal, other.goal)


def test_one_environment_has_no_halves(ppo):
    batch = collected(ppo, num_envs=1)
    with pytest.raises(UserError, match=r"use scale\.num_envs=2 or more"):
        ppo.policy_gradients(batch, torch.ones(1, 4, 2)).halves()


def test_a_batch_in_parts_has_the_same_gradients(gradients, monkeypatch):
    whole = gradients.terms
    monkeypatch.setattr(policy_gradients, "ROWS", 5)
    in_parts = BatchGradients(gradients.actor, gradients.samples, gradients.advantages)
    torch.testing.assert_close(in_parts.terms, whole)


def test_the_learner_is_left_as_it_was(ppo, gradients):
    before, noise = parameters_of(ppo), ppo.exploration.get_state()
    global_noise = torch.get_rng_state()
    gradients.goal_after(gradients.terms.sum(dim=0))
    assert same(parameters_of(ppo), before)
    assert all(parameter.grad is None for parameter in ppo.actor_parameters)
    assert torch.equal(ppo.exploration.get_state(), noise)
    assert torch.equal(torch.get_rng_state(), global_noise)
