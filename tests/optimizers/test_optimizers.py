"""What every weight optimizer must do, whichever it is, made as the configuration makes it."""

from pathlib import Path
from typing import Any

import pytest
import torch
from hydra.utils import instantiate
from omegaconf import OmegaConf

import conf
from tlr_exp.objective import RankDeviation
from tlr_exp.optimizers.protocol import WeightOptimizer, WeightUpdate

CHOICES = ["fixed", "gwo", "random"]
NUM_TERMS = 5


def make(choice: str, seed: int = 0, **settings: Any) -> WeightOptimizer:
    directory = Path(conf.__path__[0]) / "optimizer"
    settings = {"num_terms": NUM_TERMS, "objective": RankDeviation(), "seed": seed, **settings}
    return instantiate(OmegaConf.load(directory / f"{choice}.yaml"), **settings)


def returns(seed: int, num_terms: int = NUM_TERMS) -> tuple[torch.Tensor, torch.Tensor]:
    """Penalties as large as the goal return: J is not 0 at the weights 1."""
    generator = torch.Generator().manual_seed(seed)
    goal_return = torch.rand(200, generator=generator)
    return goal_return, -torch.rand(200, num_terms, generator=generator)


def same(a: WeightUpdate, b: WeightUpdate) -> bool:
    rest = [(u.objective, u.baseline_objective, u.evaluations, u.optimal_share) for u in (a, b)]
    return torch.equal(a.weights, b.weights) and rest[0] == rest[1]


@pytest.mark.parametrize("choice", CHOICES)
def test_the_update_describes_its_weights(choice: str) -> None:
    goal_return, term_returns = returns(1)
    update = make(choice).update(goal_return, term_returns)
    assert update.weights.shape == (NUM_TERMS,)
    assert update.weights.dtype == torch.float32
    assert ((update.weights >= 0) & (update.weights <= 1)).all()
    objective = RankDeviation().prepare(goal_return, term_returns)
    assert update.objective == objective(update.weights[None]).item()
    assert update.baseline_objective == objective(torch.ones(1, NUM_TERMS)).item() > 0
    assert 0.0 < update.optimal_share <= 1.0


@pytest.mark.parametrize("choice", CHOICES)
def test_the_same_seed_gives_the_same_bits(choice: str) -> None:
    first, second = make(choice, seed=3), make(choice, seed=3)
    for iteration in range(3):
        assert same(first.update(*returns(iteration)), second.update(*returns(iteration)))


@pytest.mark.parametrize("choice", ["gwo", "random"])
def test_seeds_and_iterations_differ(choice: str) -> None:
    one, other = make(choice, seed=3), make(choice, seed=4)
    weights = [o.update(*returns(0)).weights for o in (one, one, other)]
    assert not torch.equal(weights[0], weights[1])
    assert not torch.equal(weights[0], weights[2])


@pytest.mark.parametrize(
    ("choice", "settings"),
    [("fixed", {}), ("random", {}), ("gwo", {}), ("gwo", {"warm_start": True})],
)
def test_a_saved_optimizer_continues_bit_for_bit(
    choice: str, settings: dict[str, Any], tmp_path: Path
) -> None:
    alone = make(choice, seed=3, **settings)
    for iteration in range(2):
        alone.update(*returns(iteration))
    torch.save(alone.state_dict(), tmp_path / "optimizer.pt")
    expected = [alone.update(*returns(iteration)) for iteration in (2, 3)]

    resumed = make(choice, seed=99, **settings)
    resumed.load_state_dict(torch.load(tmp_path / "optimizer.pt", weights_only=True))
    found = [resumed.update(*returns(iteration)) for iteration in (2, 3)]
    assert all(same(a, b) for a, b in zip(expected, found, strict=True))


@pytest.mark.parametrize("choice", CHOICES)
def test_a_saved_state_does_not_change_afterwards(choice: str) -> None:
    optimizer = make(choice)
    optimizer.update(*returns(0))
    state = optimizer.state_dict()
    before = {name: value.clone() for name, value in state.items()}
    update = optimizer.update(*returns(1))
    update.weights.zero_()
    assert all(torch.equal(state[name], before[name]) for name in before)
    assert set(state) == set(before)


@pytest.mark.parametrize(
    ("choice", "settings"), [("fixed", {}), ("random", {}), ("gwo", {"warm_start": True})]
)
def test_changing_the_returned_weights_does_not_reach_the_optimizer(
    choice: str, settings: dict[str, Any]
) -> None:
    touched, untouched = make(choice, seed=3, **settings), make(choice, seed=3, **settings)
    for iteration in range(3):
        one, other = touched.update(*returns(iteration)), untouched.update(*returns(iteration))
        assert same(one, other)
        one.weights.zero_()
    saved = untouched.state_dict()
    assert all(torch.equal(value, saved[name]) for name, value in touched.state_dict().items())


@pytest.mark.parametrize("choice", CHOICES)
def test_the_global_generator_is_left_alone(choice: str) -> None:
    before = torch.get_rng_state()
    make(choice).update(*returns(0))
    assert torch.equal(torch.get_rng_state(), before)


@pytest.mark.parametrize("choice", CHOICES)
def test_the_order_of_the_environments_does_not_matter(choice: str) -> None:
    goal_return, term_returns = returns(0)
    shuffled = torch.randperm(200, generator=torch.Generator().manual_seed(0))
    one = make(choice).update(goal_return, term_returns)
    other = make(choice).update(goal_return[shuffled], term_returns[shuffled])
    assert same(one, other)


@pytest.mark.parametrize("choice", CHOICES)
def test_returns_of_another_number_of_terms_are_refused(choice: str) -> None:
    with pytest.raises(ValueError, match=r"\(200, 4\), expected \[num_envs, 5\]"):
        make(choice).update(*returns(0, num_terms=4))


@pytest.mark.parametrize("choice", CHOICES)
def test_the_state_of_another_kind_of_optimizer_is_refused(choice: str) -> None:
    with pytest.raises(ValueError, match=r"another kind of optimizer"):
        make(choice).load_state_dict({"swarm": torch.zeros(1)})


@pytest.mark.parametrize("choice", ["gwo", "random"])
def test_the_state_for_another_number_of_terms_is_refused(choice: str) -> None:
    with pytest.raises(ValueError, match=r"shape \(4,\), this one has 5 terms"):
        make(choice).load_state_dict(make(choice, num_terms=4).state_dict())


@pytest.mark.parametrize("choice", ["gwo", "random"])
@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"num_terms": 0}, r"num_terms must be .* at least 1, got 0: .*no optimizing terms"),
        ({"seed": -1}, r"seed must be .* at least 0, got -1"),
        ({"lower": 1.0, "upper": 1.0}, r"lower 1\.0 and upper 1\.0 .* lower < upper"),
        ({"upper": float("inf")}, r"upper inf must be finite"),
        ({"lower": float("nan")}, r"lower nan"),
    ],
)
def test_bad_settings_are_refused(choice: str, settings: dict[str, Any], message: str) -> None:
    with pytest.raises(Exception, match=message):  # hydra wraps the ValueError
        make(choice, **settings)


@pytest.mark.parametrize("choice", ["gwo", "random"])
def test_weights_stay_within_other_bounds(choice: str) -> None:
    optimizer = make(choice, lower=0.25, upper=0.5)
    for iteration in range(5):
        weights = optimizer.update(*returns(iteration)).weights
        assert ((weights >= 0.25) & (weights <= 0.5)).all()
