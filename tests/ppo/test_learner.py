"""The learner's arithmetic: advantages at a cut, losses and KL by hand, step sizes, gradients."""

import math

import pytest
import torch
from learners import (
    ONE_PASS,
    collected,
    first_observation_as_value,
    ready,
    same,
)
from tensordict import TensorDict, TensorDictBase
from torch import Tensor, nn
from torchrl.envs import ExplorationType, set_exploration_type
from torchrl.objectives.value import GAE

from tlr_exp import keys
from tlr_exp.ppo.learner import Ppo, explained_variance

# --- advantages ------------------------------------------------------------------------------


def test_advantages_at_a_cut_by_hand(make_ppo):
    # gamma = 0.5, lambda = 0.25, rewards 1; V = 1, 2, 3 along the three steps and 4 after them.
    # Row 0, no cut: deltas 1 + 2/2 - 1 = 1, 1 + 3/2 - 2 = 0.5, 1 + 4/2 - 3 = 0;
    #   A2 = 0, A1 = 0.5 + 0.125 * 0 = 0.5, A0 = 1 + 0.125 * 0.5 = 1.0625.
    # The second step of rows 1 and 2 ends an episode, in a state of value 7; V = 3 is the start
    # of the next one, and nothing flows back from it.
    # Row 1, terminated: delta1 = 1 - 2 = -1 = A1; A0 = 1 + 0.125 * -1 = 0.875; A2 = 0.
    # Row 2, truncated: delta1 = 1 + 7/2 - 2 = 2.5 = A1; A0 = 1 + 0.125 * 2.5 = 1.3125; A2 = 0.
    ppo = make_ppo("ppo.gamma=0.5", "ppo.gae_lambda=0.25", critic=first_observation_as_value())
    value = torch.tensor([[1.0, 2.0, 3.0]] * 3)
    value_after = torch.tensor([[2.0, 3.0, 4.0], [2.0, 7.0, 4.0], [2.0, 7.0, 4.0]])
    terminated, truncated = torch.zeros(2, 3, 3, 1, dtype=torch.bool)
    terminated[1, 1], truncated[2, 1] = True, True

    def observations(first: Tensor) -> Tensor:
        return torch.cat((first[..., None], torch.full((3, 3, 3), 9.0)), dim=-1)

    after = {
        keys.OBSERVATION: observations(value_after),
        keys.REWARD: torch.ones(3, 3, 1),
        keys.TERMINATED: terminated,
        keys.TRUNCATED: truncated,
        keys.DONE: terminated | truncated,
    }
    batch = TensorDict({keys.OBSERVATION: observations(value), "next": after}, [3, 3])
    ppo.estimate_advantages(batch)
    expected = torch.tensor([[1.0625, 0.5, 0.0], [0.875, -1.0, 0.0], [1.3125, 2.5, 0.0]])
    torch.testing.assert_close(batch["value_target"].squeeze(-1), expected + value)
    # Normalised over all nine: sum 5.25; the squares sum to
    # 1.12890625 + 0.25 + 0.765625 + 1 + 1.72265625 + 6.25 = 11.1171875.
    mean = 5.25 / 9
    deviation = math.sqrt((11.1171875 - 9 * mean**2) / 8)
    torch.testing.assert_close(batch["advantage"].squeeze(-1), (expected - mean) / deviation)
    assert not batch["advantage"].requires_grad


def test_advantages_are_those_of_torchrl_which_asks_the_critic_about_every_state(make_ppo):
    ppo = make_ppo()
    batch = collected(ppo, num_envs=16, num_steps=8)
    going_on = ~batch["next", keys.DONE][:, :-1].squeeze(-1)
    for key in (
        keys.OBSERVATION,
        keys.PRIVILEGED,
    ):  # within an episode a step begins where one ended
        batch["next", key][:, :-1][going_on] = batch[key][:, 1:][going_on]
    theirs = GAE(gamma=0.99, lmbda=0.95, value_network=ppo.critic, deactivate_vmap=True)(
        batch.clone()
    )
    valued = []
    ppo.critic.register_forward_hook(lambda _, inputs, __: valued.append(len(inputs[0])))
    ppo.estimate_advantages(batch)
    torch.testing.assert_close(batch["value_target"], theirs["value_target"])
    cuts = (~going_on).sum().item() + 16
    assert valued == [16 * 8, cuts]


# --- losses by hand --------------------------------------------------------------------------


def present_log_prob(ppo: Ppo, batch: TensorDictBase) -> Tensor:
    with torch.no_grad():
        return ppo.actor.get_dist(batch.select(keys.OBSERVATION)).log_prob(batch[keys.ACTION])


@pytest.mark.parametrize(
    ("advantage", "surrogate"),
    # Ratio 2, clipped at 1.2: -min(2, 1.2) = -1.2 for a gain, -min(-2, -1.2) = 2 for a loss.
    [(1.0, -1.2), (-1.0, 2.0)],
)
def test_surrogate_by_hand(make_ppo, advantage, surrogate):
    ppo = make_ppo(*ONE_PASS)
    batch = ready(ppo)
    batch["action_log_prob"] = present_log_prob(ppo, batch) - math.log(2.0)
    batch["advantage"] = torch.full_like(batch["advantage"], advantage)
    diagnostics = ppo.update(batch)
    assert diagnostics.surrogate_loss == pytest.approx(surrogate, rel=1e-5)
    assert diagnostics.clip_fraction == 1.0


@pytest.mark.parametrize(
    ("target", "loss"),
    # The value moved from 1 to 2; a change beyond 0.2 does not count: 1.2. The worse of both
    # squares: max((1 - 2)^2, (1 - 1.2)^2) = 1 and max((3 - 2)^2, (3 - 1.2)^2) = 3.24.
    [(1.0, 1.0), (3.0, 3.24)],
)
def test_clipped_value_loss_by_hand(make_ppo, target, loss):
    ppo = make_ppo(*ONE_PASS, "ppo.critic_coeff=0.5", critic=first_observation_as_value())
    batch = ready(ppo)
    batch[keys.OBSERVATION][..., 0] = 2.0
    batch["state_value"] = torch.ones_like(batch["state_value"])
    batch["value_target"] = torch.full_like(batch["value_target"], target)
    assert ppo.update(batch).value_loss == pytest.approx(0.5 * loss, rel=1e-5)


def test_explained_variance_by_hand():
    """Targets 0, 2, 4, 6 have the variance 20/3; errors of 1, -1, 1, -1 have 4/3."""
    target = torch.tensor([0.0, 2.0, 4.0, 6.0])
    error = torch.tensor([1.0, -1.0, 1.0, -1.0])
    assert explained_variance(target, target - error) == pytest.approx(0.8)
    assert explained_variance(target, target + 7.0) == pytest.approx(1.0)
    assert explained_variance(target, torch.full((4,), 3.0)) == pytest.approx(0.0)
    assert math.isnan(explained_variance(torch.ones(4), target))


def test_entropy_and_standard_deviation_of_the_gaussian(make_ppo):
    ppo = make_ppo(*ONE_PASS, "ppo.initial_std=0.5")
    diagnostics = ppo.update(ready(ppo))
    # Three independent normals: 3/2 ln(2 pi e) + 3 ln 0.5.
    expected = 1.5 * math.log(2 * math.pi * math.e) + 3 * math.log(0.5)
    assert diagnostics.entropy == pytest.approx(expected, rel=1e-5)
    assert diagnostics.action_std == pytest.approx(0.5)


def test_entropy_bonus_widens_the_policy(make_ppo):
    def std_after(coefficient: float) -> float:
        ppo = make_ppo(*ONE_PASS, f"ppo.entropy_coeff={coefficient}", "ppo.target_kl=null")
        batch = ready(ppo)
        batch["advantage"] = torch.zeros_like(batch["advantage"])
        ppo.update(batch)
        return ppo.actor(batch.clone())["scale"].mean().item()

    # The first step of Adam is as long as the learning rate, here of ln std: 0.8 * e^0.001.
    assert std_after(0.0) == pytest.approx(0.8, rel=1e-5)
    assert std_after(0.1) == pytest.approx(0.8008, rel=1e-5)


def test_the_policy_that_collected_has_no_divergence_from_itself(make_ppo):
    """Also after an update: what normalises observations is the same while acting and learning."""
    ppo = make_ppo(*ONE_PASS)
    for seed in range(3):
        batch = collected(ppo, seed=seed)
        batch[keys.OBSERVATION].mul_(3.0).add_(5.0)
        with torch.no_grad(), set_exploration_type(ExplorationType.RANDOM):
            ppo.actor(batch)
        ppo.estimate_advantages(batch)
        diagnostics = ppo.update(batch)
        assert diagnostics.kl == pytest.approx(0.0, abs=1e-6)
        assert diagnostics.clip_fraction == 0.0
        assert diagnostics.surrogate_loss == pytest.approx(0.0, abs=1e-5)


def test_kl_divergence_is_the_closed_form(make_ppo):
    ppo = make_ppo(*ONE_PASS)
    batch = ready(ppo)
    # Old policy: 0.4 further in each of three dimensions, and 0.5 wide in place of 0.8:
    # 3 * (ln(0.8/0.5) + (0.5^2 + 0.4^2)/(2 * 0.8^2) - 1/2).
    batch["loc"] = batch["loc"] + 0.4
    batch["scale"] = torch.full_like(batch["scale"], 0.5)
    expected = 3 * (math.log(1.6) + 0.41 / 1.28 - 0.5)
    assert ppo.update(batch).kl == pytest.approx(expected, rel=1e-5)


# --- learning rate and gradients -------------------------------------------------------------


def rate_after(make_ppo, kl: float, *overrides: str) -> float:
    ppo = make_ppo(*ONE_PASS, *overrides)
    batch = ready(ppo)
    # Means of three dimensions of standard deviation 0.8, off by d: KL = 3 d^2/(2 * 0.64).
    batch["loc"] = batch["loc"] + math.sqrt(kl * 1.28 / 3)
    ppo.update(batch)
    return ppo.learning_rate


@pytest.mark.parametrize(
    ("kl", "factor"),
    [(0.021, 1 / 1.5), (0.019, 1.0), (0.0051, 1.0), (0.0049, 1.5), (0.0001, 1.5)],
)
def test_rate_follows_the_divergence(make_ppo, kl, factor):
    found = rate_after(make_ppo, kl, "ppo.learning_rate=0.001", "ppo.target_kl=0.01")
    assert found == pytest.approx(0.001 * factor)


def test_rate_stays_within_its_bounds(make_ppo):
    bounds = ("ppo.min_learning_rate=9e-4", "ppo.max_learning_rate=1.1e-3")
    assert rate_after(make_ppo, 0.5, *bounds) == pytest.approx(9e-4)
    assert rate_after(make_ppo, 0.001, *bounds) == pytest.approx(1.1e-3)


def test_rate_is_constant_without_a_target(make_ppo):
    assert rate_after(make_ppo, 0.5, "ppo.target_kl=null") == 1e-3


@pytest.mark.parametrize(
    ("decay_from", "progress", "rate"),
    [
        *((0.0, 0.0, 1e-3), (0.0, 0.25, 7.75e-4), (0.0, 1.0, 1e-4)),
        *((0.8, 0.0, 1e-3), (0.8, 0.8, 1e-3), (0.8, 0.9, 5.5e-4), (0.8, 1.0, 1e-4)),
    ],
)
def test_rate_falls_linearly_to_the_end(make_ppo, decay_from, progress, rate):
    rates = ("ppo.learning_rate=1e-3", "ppo.final_learning_rate=1e-4")
    ppo = make_ppo(*ONE_PASS, "ppo.target_kl=null", *rates, f"ppo.decay_from={decay_from}")
    assert ppo.update(ready(ppo), progress).learning_rate == pytest.approx(rate)


def gradient_norm(parameters: list[nn.Parameter]) -> float:
    return math.sqrt(sum(p.grad.double().square().sum().item() for p in parameters))


def test_gradients_of_actor_and_critic_are_clipped_apart(make_ppo):
    calm, torn = make_ppo(*ONE_PASS), make_ppo(*ONE_PASS)
    for ppo, factor in ((calm, 0.01), (torn, 1e4)):
        batch = ready(ppo)
        batch["value_target"] = batch["state_value"] + factor * batch["value_target"]
        ppo.update(batch)
    # A critic far off gets a gradient of norm 1, and takes nothing from the actor's.
    assert gradient_norm(torn.critic_parameters) == pytest.approx(1.0, rel=1e-3)
    assert gradient_norm(calm.critic_parameters) < 0.9
    calm_actor, torn_actor = ([p.grad for p in x.actor_parameters] for x in (calm, torn))
    assert same(calm_actor, torn_actor)

    steep = make_ppo(*ONE_PASS)
    batch = ready(steep)
    batch["advantage"] = 1e4 * batch["advantage"]
    steep.update(batch)
    assert gradient_norm(steep.actor_parameters) == pytest.approx(1.0, rel=1e-3)
