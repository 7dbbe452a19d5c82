"""Gradients of the policy reward by reward: advantages by hand, gradients by autograd and steps."""

import copy
import math

import pytest
import torch
from learners import collected, first_observation_as_value, parameters_of, same
from torch import Tensor
from torch.nn.utils import parameters_to_vector, vector_to_parameters

from tlr_exp import keys
from tlr_exp.errors import UserError
from tlr_exp.ppo import policy_gradients
from tlr_exp.ppo.learner import Ppo
from tlr_exp.ppo.policy_gradients import BatchGradients, advantages_apart, linear_values

STEP_SIZE = 0.5


def test_values_by_hand():
    # From the state (1, 0) to (0, 1), where the episode ends by failure; gamma = 0.5.
    # Rewards 1, then 2: 2 in the second state, 1 + 0.5 * 2 = 2 in the first. Rewards 0, then 4:
    # 4 and 2. Where it is only cut off, the state that follows, (0, 1) again, is worth 2 V:
    # V = 2 + 0.5 V = 4 in the second state, 1 + 0.5 * 4 = 3 in the first; 8 and 4.
    features = torch.eye(2)[None]
    rewards = torch.tensor([[[1.0, 0.0], [2.0, 4.0]]])
    after = torch.tensor([[[0.0, 1.0], [0.0, 1.0]]])
    failed = torch.tensor([[[False], [True]]])
    near = {"rtol": 0.01, "atol": 0.0}  # the ridge
    values, values_after = linear_values(features, after, rewards, failed, gamma=0.5)
    torch.testing.assert_close(values, torch.tensor([[[2.0, 2.0], [2.0, 4.0]]]), **near)
    torch.testing.assert_close(values_after[0, 0], values[0, 1])
    values, _ = linear_values(features, after, rewards, torch.zeros_like(failed), gamma=0.5)
    torch.testing.assert_close(values, torch.tensor([[[3.0, 4.0], [4.0, 8.0]]]), **near)


def test_advantages_by_hand():
    # gamma lambda = 0.5, values 0; an episode of the first environment ends with its second step.
    # The first reward is 1, 2, 4 there and 0 in the second environment. With the cut the sums are
    # 1 + 0.5 * 2 = 2, 2, 4 and 0; their mean is 4/3.
    # The second comes after it: sums 0, 0, 2 where the episode has ended, 0.5, 1, 2 in the other.
    first = torch.tensor([[1.0, 2.0, 4.0], [0.0, 0.0, 0.0]])
    second = torch.tensor([[0.0, 0.0, 2.0], [0.0, 0.0, 2.0]])
    done = torch.zeros(2, 3, 1, dtype=torch.bool)
    done[0, 1] = True
    rewards = torch.stack((first, second), dim=-1)
    nothing = torch.zeros_like(rewards)
    found = advantages_apart(rewards, (nothing, nothing), done, done, gamma=0.625, gae_lambda=0.8)
    # Squares of the first, times 9: 4 + 4 + 64 + 3 * 16 = 120.
    deviation = math.sqrt(120 / 9 / 5)
    goal = torch.tensor([[2.0, 2.0, 8.0], [-4.0, -4.0, -4.0]]) / 3
    torch.testing.assert_close(found[..., 0], goal / deviation)
    sums = torch.tensor([[0.0, 0.0, 2.0], [0.5, 1.0, 2.0]])
    torch.testing.assert_close(found[..., 1], (sums - 5.5 / 6) / deviation)


def test_a_value_counts_as_it_does_for_the_learner(make_ppo):
    """The learner's advantages, from its own critic's values and rewards; see test_learner."""
    ppo = make_ppo()
    batch = collected(ppo)
    ppo.estimate_advantages(batch)
    values = batch["state_value"], ppo._after(batch["state_value"], batch["next"], ppo._values)
    after, settings = batch["next"], ppo.settings
    found = advantages_apart(
        *(after[keys.REWARD], values, after[keys.DONE], after[keys.TERMINATED]),
        *(settings.gamma, settings.gae_lambda),
    )
    torch.testing.assert_close(found, batch["advantage"])


def test_the_advantages_of_a_composed_reward_are_composed(make_ppo):
    ppo = make_ppo()
    batch, generator = collected(ppo), torch.Generator().manual_seed(5)
    goal, term = torch.randn(2, *batch.shape, 1, generator=generator)
    rewards = torch.cat((goal, term, goal + 0.3 * term), dim=-1)
    found = ppo.policy_gradients(batch, rewards).advantages
    torch.testing.assert_close(
        found[..., 2], found[..., 0] + 0.3 * found[..., 1], rtol=1e-3, atol=1e-4
    )


def test_a_linear_critic_foretells_what_the_learners_features_tell(make_ppo):
    """Where the reward makes the first feature the value, the advantages are nothing but noise."""
    ppo = make_ppo(critic=first_observation_as_value())
    batch = collected(ppo, num_envs=256)
    after = batch["next"]
    going_on = ~after[keys.DONE][:, :-1].squeeze(-1)
    after[keys.OBSERVATION][:, :-1][going_on] = batch[keys.OBSERVATION][:, 1:][going_on]
    now, then = batch[keys.OBSERVATION][..., :1], after[keys.OBSERVATION][..., :1]
    foreseen = now - ppo.settings.gamma * then * ~after[keys.TERMINATED]
    noise = torch.randn(foreseen.shape, generator=torch.Generator().manual_seed(6))
    rewards = torch.cat((noise, foreseen), dim=-1)
    found = ppo.policy_gradients(batch, rewards).advantages
    assert found[..., 1].std() < 0.05


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
