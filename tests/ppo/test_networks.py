"""Running normalisation against NumPy; what actor and critic write."""

import math

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from tensordict import TensorDict
from torchrl.envs import ExplorationType, set_exploration_type

from tlr_exp import keys
from tlr_exp.config.limits import ACTIVATIONS as ALLOWED_ACTIVATIONS
from tlr_exp.ppo.networks import (
    ACTIVATIONS,
    SMALLEST_STD,
    GaussianHead,
    RunningNorm,
    build_actor,
    build_critic,
    update_norms,
)

OBSERVATION_DIM, PRIVILEGED_DIM, ACTION_DIM = 6, 4, 3

batches = st.lists(
    st.integers(1, 8).flatmap(
        lambda rows: arrays(
            np.float32, (rows, 2), elements=st.floats(-50.0, 50.0, width=16, allow_nan=False)
        )
    ),
    min_size=1,
    max_size=6,
)


# --- running normalisation -------------------------------------------------------------------


@given(batches)
def test_many_batches_are_as_good_as_one(parts):
    norm = RunningNorm(2)
    for part in parts:
        norm.update(torch.from_numpy(part))
    whole = np.concatenate(parts).astype(np.float64)
    assert norm.count.item() == len(whole)
    np.testing.assert_allclose(norm.mean.numpy(), whole.mean(axis=0), atol=1e-5)
    np.testing.assert_allclose(norm.variance.numpy(), whole.var(axis=0), atol=1e-3, rtol=1e-5)


def test_statistics_far_from_zero_keep_their_precision():
    # Mean 1000, standard deviation 0.1: a sum of squares in float32 knows nothing of it.
    generator = torch.Generator().manual_seed(0)
    norm = RunningNorm(1)
    parts = [1000.0 + 0.1 * torch.randn(500, 1, generator=generator) for _ in range(20)]
    for part in parts:
        norm.update(part)
    whole = torch.cat(parts).double().numpy()
    assert norm.variance.item() == pytest.approx(whole.var(), rel=1e-3)
    assert norm.mean.item() == pytest.approx(whole.mean(), abs=1e-4)


def test_a_batch_of_steps_counts_every_row():
    generator = torch.Generator().manual_seed(0)
    batch = torch.randn(4, 5, 3, generator=generator)
    shaped, flat = RunningNorm(3), RunningNorm(3)
    shaped.update(batch)
    flat.update(batch.reshape(20, 3))
    assert torch.equal(shaped.mean, flat.mean)
    assert torch.equal(shaped.variance, flat.variance)


def test_before_any_update_values_pass_through_within_the_clip():
    value = torch.tensor([[-3.0, 0.5, 250.0]])
    assert RunningNorm(3)(value).tolist() == [[-3.0, 0.5, 10.0]]


def test_normalised_values_by_hand():
    # Mean 3, variance 4 (of 1 and 5): (9 - 3)/2 = 3; -100 is cut off at the clip.
    norm = RunningNorm(1, clip=5.0)
    norm.update(torch.tensor([[1.0], [5.0]]))
    assert norm(torch.tensor([[9.0], [3.0], [-100.0]])).flatten().tolist() == pytest.approx(
        [3.0, 0.0, -5.0], abs=1e-4
    )


def test_a_constant_column_does_not_blow_up():
    norm = RunningNorm(1)
    norm.update(torch.full((10, 1), 0.25))
    assert norm(torch.tensor([[0.25]])).item() == pytest.approx(0.0, abs=1e-6)
    assert norm(torch.tensor([[0.26]])).isfinite().all()


def test_only_an_update_changes_the_statistics():
    norm = RunningNorm(2).train()
    norm.update(torch.randn(8, 2, generator=torch.Generator().manual_seed(0)))
    before = {name: value.clone() for name, value in norm.state_dict().items()}
    norm(torch.full((100, 2), 7.0))
    assert all(torch.equal(before[name], value) for name, value in norm.state_dict().items())


def test_restored_statistics_go_on_bit_for_bit():
    generator = torch.Generator().manual_seed(0)
    first, second, probe = (torch.randn(9, 2, generator=generator) for _ in range(3))
    norm, other = RunningNorm(2), RunningNorm(2)
    norm.update(first)
    other.load_state_dict(norm.state_dict())
    assert torch.equal(other(probe), norm(probe))
    for each in (norm, other):
        each.update(second)
    assert torch.equal(other.variance, norm.variance)
    assert torch.equal(other(probe), norm(probe))


# --- actor -----------------------------------------------------------------------------------


@pytest.fixture
def settings(settings_of):
    return settings_of("ppo.hidden_sizes=[16,8]").ppo


def make_actor(settings, seed: int = 0, noise: int | None = 0):
    """Networks that are equal at every call; ``noise`` seeds their exploration."""
    with torch.random.fork_rng():
        torch.manual_seed(seed)
        generator = None if noise is None else torch.Generator().manual_seed(noise)
        return build_actor(OBSERVATION_DIM, ACTION_DIM, settings, generator)


def observed(num: int = 5) -> TensorDict:
    generator = torch.Generator().manual_seed(3)
    return TensorDict(
        {keys.OBSERVATION: torch.randn(num, OBSERVATION_DIM, generator=generator)}, [num]
    )


def act(actor, mode=ExplorationType.RANDOM) -> TensorDict:
    with set_exploration_type(mode), torch.no_grad():
        return actor(observed())


def test_actor_writes_distribution_action_and_log_probability(settings):
    result = act(make_actor(settings))
    for name in ("loc", "scale", keys.ACTION):
        assert result[name].shape == (5, ACTION_DIM)
    expected = torch.distributions.Normal(result["loc"], result["scale"]).log_prob(
        result[keys.ACTION]
    )
    torch.testing.assert_close(result["action_log_prob"], expected.sum(dim=-1))


def test_standard_deviation_is_the_setting_in_every_state(settings):
    result = act(make_actor(settings))
    torch.testing.assert_close(result["scale"], torch.full((5, ACTION_DIM), 0.8))
    assert result["loc"].unique(dim=0).shape[0] == 5


def test_exploration_depends_on_its_generator_alone(settings):
    torch.manual_seed(1)
    first = act(make_actor(settings, noise=7))
    torch.manual_seed(2)
    again = act(make_actor(settings, noise=7))
    assert torch.equal(first[keys.ACTION], again[keys.ACTION])
    other = act(make_actor(settings, noise=8))
    assert torch.equal(first["loc"], other["loc"])
    assert not torch.equal(first[keys.ACTION], other[keys.ACTION])
    before = torch.get_rng_state()
    act(make_actor(settings, noise=7))
    assert torch.equal(torch.get_rng_state(), before)


def test_exploration_goes_on_and_can_be_rewound(settings):
    generator = torch.Generator().manual_seed(7)
    actor = build_actor(OBSERVATION_DIM, ACTION_DIM, settings, generator)
    state = generator.get_state()
    first, second = act(actor)[keys.ACTION], act(actor)[keys.ACTION]
    assert not torch.equal(first, second)
    generator.set_state(state)
    assert torch.equal(act(actor)[keys.ACTION], first)


def test_exploration_noise_has_the_stated_distribution(settings):
    actor = make_actor(settings)
    with set_exploration_type(ExplorationType.RANDOM), torch.no_grad():
        result = actor(observed(4000))
    noise = (result[keys.ACTION] - result["loc"]) / result["scale"]
    # 12000 draws: the mean's standard error is 0.009, that of the standard deviation 0.0065.
    assert noise.mean().item() == pytest.approx(0.0, abs=0.04)
    assert noise.std().item() == pytest.approx(1.0, abs=0.03)


def test_deterministic_actions_are_the_mean(settings):
    result = act(make_actor(settings), ExplorationType.DETERMINISTIC)
    assert torch.equal(result[keys.ACTION], result["loc"])


def test_loading_parameters_makes_equal_policies(settings):
    actor, other = make_actor(settings, seed=0), make_actor(settings, seed=1)
    update_norms(actor, 2.0 + observed(50)[keys.OBSERVATION])
    assert not torch.equal(act(actor)["loc"], act(other)["loc"])
    other.load_state_dict(actor.state_dict())
    assert torch.equal(act(actor)["loc"], act(other)["loc"])


@pytest.mark.parametrize("name", sorted(ACTIVATIONS))
def test_every_activation_works(settings_of, name):
    assert set(ACTIVATIONS) == set(ALLOWED_ACTIVATIONS)
    settings = settings_of("ppo.hidden_sizes=[8]", f"ppo.activation={name}").ppo
    actor = make_actor(settings)
    assert act(actor)["loc"].isfinite().all()
    assert any(isinstance(module, ACTIVATIONS[name]) for module in actor.modules())


def test_layers_have_the_sizes_of_the_setting(settings):
    widths = [
        (layer.in_features, layer.out_features)
        for layer in make_actor(settings).modules()
        if isinstance(layer, torch.nn.Linear)
    ]
    assert widths == [(6, 16), (16, 8), (8, 3)]


# --- critic and normalisation of both --------------------------------------------------------


def test_critic_sees_both_observations(settings):
    critic = build_critic(OBSERVATION_DIM, PRIVILEGED_DIM, settings)
    generator = torch.Generator().manual_seed(0)
    batch = observed()
    batch[keys.PRIVILEGED] = torch.randn(5, PRIVILEGED_DIM, generator=generator)
    value = critic(batch.clone())["state_value"]
    assert value.shape == (5, 1)
    for name in (keys.OBSERVATION, keys.PRIVILEGED):
        changed = batch.clone()
        changed[name] = changed[name] + 1.0
        assert (critic(changed)["state_value"] != value).all()
    # Time is one more leading dimension.
    assert critic(batch.unsqueeze(1).expand(5, 2))["state_value"].shape == (5, 2, 1)


def test_normalisation_can_be_left_out(settings_of):
    settings = settings_of("ppo.hidden_sizes=[8]", "ppo.normalize_observations=false").ppo
    actor = make_actor(settings)
    before = act(actor)["loc"]
    update_norms(actor, 100.0 + observed(50)[keys.OBSERVATION])
    assert torch.equal(act(actor)["loc"], before)


def test_updated_norms_reach_the_first_layer(settings):
    actor = make_actor(settings)
    batch = 5.0 + 3.0 * observed(200)[keys.OBSERVATION]
    update_norms(actor, batch)
    (norm,) = (module for module in actor.modules() if isinstance(module, RunningNorm))
    normalised = norm(batch)
    torch.testing.assert_close(normalised.mean(dim=0), torch.zeros(6), atol=1e-5, rtol=0)
    torch.testing.assert_close(
        normalised.std(dim=0), torch.full((6,), math.sqrt(200 / 199)), atol=1e-4, rtol=0
    )


def test_a_standard_deviation_that_is_learned_linearly_stays_positive():
    mean = torch.zeros(3, 2)
    linear, log = GaussianHead(2, 0.5, "linear"), GaussianHead(2, 0.5)
    torch.testing.assert_close(linear(mean)[1], log(mean)[1])
    # The derivative by the parameter: 1 and the deviation itself.
    for head, slope in ((linear, 1.0), (log, 0.5)):
        head(mean)[1][0].sum().backward()
        (parameter,) = head.parameters()
        torch.testing.assert_close(parameter.grad, torch.full((2,), slope))
    with torch.no_grad():
        linear.std.fill_(-1.0)
    assert (linear(mean)[1] == SMALLEST_STD).all()
