"""The learner at work: minibatches, what is not finite, learning, exact resume."""

import io

import pytest
import torch
from learners import ONE_PASS, collected, parameters_of, ready, same
from tensordict import TensorDictBase
from torch import Tensor

from tlr_exp import keys
from tlr_exp.ppo.learner import NonFiniteLossError, Ppo
from tlr_exp.ppo.networks import RunningNorm

# --- minibatches -----------------------------------------------------------------------------


@pytest.mark.parametrize(("num_envs", "sizes"), [(8, [2, 2, 2, 2]), (5, [2, 1, 1, 1])])
def test_every_epoch_takes_each_sample_once_in_a_new_order(make_ppo, monkeypatch, num_envs, sizes):
    ppo = make_ppo("ppo.num_epochs=3", "ppo.num_minibatches=4")
    batch = ready(ppo, num_envs=num_envs, num_steps=1)
    batch["advantage"] = torch.arange(float(num_envs)).reshape(num_envs, 1, 1)
    seen = []

    def watch(minibatch: TensorDictBase, epoch: int) -> Tensor:
        seen.append(minibatch["advantage"].flatten().tolist())
        return torch.ones(6)

    monkeypatch.setattr(ppo, "_update_once", watch)
    assert ppo.update(batch).kl == 1.0  # the mean over all minibatches
    assert [len(part) for part in seen] == 3 * sizes
    parts = [seen[4 * epoch : 4 * epoch + 4] for epoch in range(3)]
    orders = [[sample for part in epoch for sample in part] for epoch in parts]
    assert all(sorted(order) == list(range(num_envs)) for order in orders)
    assert orders[0] != orders[1]


def test_norms_take_in_the_batch_once_after_the_update(make_ppo):
    ppo = make_ppo()
    batch = ready(ppo)
    ppo.update(batch)
    norms = [
        m for net in (ppo.actor, ppo.critic) for m in net.modules() if isinstance(m, RunningNorm)
    ]
    assert [norm.count.item() for norm in norms] == [128, 128]
    inputs = batch[keys.OBSERVATION].flatten(0, 1), batch[keys.PRIVILEGED].flatten(0, 1)
    torch.testing.assert_close(norms[0].mean, inputs[0].mean(dim=0).double())
    torch.testing.assert_close(norms[1].mean, torch.cat(inputs, dim=-1).mean(dim=0).double())


# --- what is not finite ----------------------------------------------------------------------


@pytest.mark.parametrize("name", ["advantage", "value_target", keys.OBSERVATION])
def test_loss_that_is_not_finite_leaves_the_policy_as_it_was(make_ppo, name):
    ppo = make_ppo(*ONE_PASS)
    batch = ready(ppo)
    before, rate = parameters_of(ppo), ppo.learning_rate
    batch[name][3, 2] = torch.nan
    with pytest.raises(NonFiniteLossError, match=r"epoch 0.*ppo.learning_rate"):
        ppo.update(batch)
    assert same(parameters_of(ppo), before)
    assert ppo.learning_rate == rate


def test_gradient_that_is_not_finite_leaves_the_policy_as_it_was(make_ppo):
    ppo = make_ppo(*ONE_PASS)
    batch = ready(ppo)
    before = parameters_of(ppo)
    ppo.critic_parameters[0].register_hook(lambda gradient: torch.full_like(gradient, torch.inf))
    with pytest.raises(NonFiniteLossError, match="gradient"):
        ppo.update(batch)
    assert same(parameters_of(ppo), before)


# --- learning --------------------------------------------------------------------------------


def bandit(ppo: Ppo, seed: int) -> tuple[TensorDictBase, Tensor]:
    """One-step episodes whose reward is -|action - target|^2; targets depend on the state."""
    batch = collected(ppo, num_envs=256, num_steps=1, seed=seed)
    target = torch.cat((0.5 * batch[keys.OBSERVATION][..., :2], torch.ones(256, 1, 1)), dim=-1)
    error = (batch[keys.ACTION] - target).square().sum(dim=-1, keepdim=True)
    batch["next", keys.REWARD] = -error
    for flag in (keys.TERMINATED, keys.DONE):
        batch["next", flag] = torch.ones(256, 1, 1, dtype=torch.bool)
    batch["next", keys.TRUNCATED] = torch.zeros(256, 1, 1, dtype=torch.bool)
    return batch, target


def test_policy_and_critic_learn_a_bandit(make_ppo):
    ppo = make_ppo("ppo.learning_rate=3e-3", "ppo.num_minibatches=2")

    def distance() -> float:
        batch, target = bandit(ppo, seed=10_000)
        return (batch["loc"] - target).norm(dim=-1).mean().item()

    before, value_losses = distance(), []
    for iteration in range(25):
        batch, _ = bandit(ppo, seed=iteration)
        ppo.estimate_advantages(batch)
        value_losses.append(ppo.update(batch).value_loss)
    # The targets are 1.2 away on average at first.
    assert before > 0.9
    assert distance() < 0.25
    assert ppo.actor(batch.clone())["scale"].mean() < 0.7
    assert value_losses[-1] < 0.5 * value_losses[0]


# --- repeatability ---------------------------------------------------------------------------


def train(ppo: Ppo, seeds: range) -> None:
    for seed in seeds:
        batch = collected(ppo, seed=seed)
        ppo.estimate_advantages(batch)
        ppo.update(batch)


def test_equal_seeds_learn_the_same_bits_whatever_the_global_generator(make_ppo):
    first, again, other = make_ppo(), make_ppo(), make_ppo()
    other.generator.manual_seed(99)
    for ppo, seed in ((first, 1), (again, 2), (other, 3)):
        torch.manual_seed(seed)
        before = torch.get_rng_state()
        train(ppo, range(3))
        assert torch.equal(torch.get_rng_state(), before)
    assert same(parameters_of(first), parameters_of(again))
    assert not same(parameters_of(first), parameters_of(other))


def test_saved_learner_goes_on_bit_for_bit(make_ppo):
    ppo = make_ppo()
    train(ppo, range(3))
    buffer = io.BytesIO()
    torch.save(ppo.state_dict(), buffer)
    buffer.seek(0)
    other = make_ppo(seed=50)
    train(other, range(1))
    other.load_state_dict(torch.load(buffer, weights_only=True))
    assert other.learning_rate == ppo.learning_rate
    for each in (ppo, other):
        train(each, range(3, 6))
    assert same(parameters_of(ppo), parameters_of(other))
    assert ppo.learning_rate == other.learning_rate
    assert torch.equal(collected(ppo)[keys.ACTION], collected(other)[keys.ACTION])
