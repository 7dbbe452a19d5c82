"""What every weight optimizer must do, whichever it is, made as the configuration makes it."""

import random
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from configured import make
from landscapes import Recorder, constant, plateau, uneven_bowl
from policies import random_gradients

import conf
from tlr_exp.env.terms import PAPER_LOWER_LAYER
from tlr_exp.optimizer.effective_dimension import setting_for
from tlr_exp.optimizer.protocol import PolicyGradients, TrainingProgress, WeightUpdate
from tlr_exp.reward.objectives import RankDeviation

CHOICES = sorted(path.stem for path in (Path(conf.__path__[0]) / "optimizer").glob("*.yaml"))
GRADIENTS = ["gradnorm", "meta_gradient", "pcgrad"]  # weigh by policy gradients
UNSEARCHED = ["curriculum", "fixed", "lagrangian", "random", "zero", *GRADIENTS]
AROUND = ["smoothed", "staged", "under_curriculum", "when_tracking"]  # in files of their own
SEARCHES = [choice for choice in CHOICES if choice not in (*UNSEARCHED, *AROUND)]
BOXED = [
    *(choice for choice in SEARCHES if choice != "effective_dimension"),
    *("random", "gradnorm", "meta_gradient"),
]
# Beside every choice with its own settings, those that keep more between iterations.
VARIANTS = [
    *((choice, {}) for choice in CHOICES),
    ("gwo", {"warm_start": True}),
    ("gwo", {"persistent": True}),
    ("cma_es", {"warm_start": True}),
    ("effective_dimension", {"inner": {"warm_start": True}}),
]
BUDGET = 30 + 30 * 50  # of the paper's search, as conf/optimizer/gwo.yaml has it
COSTS = dict.fromkeys(PAPER_LOWER_LAYER[:5], 1e-6)  # below every limit: multipliers fall from 1
NUM_TERMS = len(COSTS)


def returns(seed: int, num_terms: int = NUM_TERMS) -> tuple[torch.Tensor, torch.Tensor]:
    """Penalties as large as the goal return: J is not 0 at the weights 1."""
    generator = torch.Generator().manual_seed(seed)
    goal_return = torch.rand(200, generator=generator)
    return goal_return, -torch.rand(200, num_terms, generator=generator)


def asked(
    optimizer: Any, iteration: int, trajectories: tuple[torch.Tensor, torch.Tensor] | None = None
) -> WeightUpdate:
    """The weights of an iteration: told first, as in a training, then asked."""
    gradients = random_gradients(iteration, NUM_TERMS)
    optimizer.observe(
        TrainingProgress(50.0, 24, mean_terms=COSTS, policy_gradients=lambda: gradients)
    )
    return optimizer.update(*(trajectories or returns(iteration)))


def same(a: WeightUpdate, b: WeightUpdate) -> bool:
    rest = [
        (u.objective, u.baseline_objective, u.evaluations, u.optimal_share, u.details)
        for u in (a, b)
    ]
    return torch.equal(a.weights, b.weights) and rest[0] == rest[1]


@pytest.mark.parametrize("choice", CHOICES)
def test_the_update_describes_its_weights(choice: str) -> None:
    goal_return, term_returns = returns(1)
    update = asked(make(choice), 1)
    assert update.weights.shape == (NUM_TERMS,)
    assert update.weights.dtype == torch.float32
    assert ((update.weights >= 0) & (update.weights <= 1)).all()
    objective = RankDeviation(0.1).prepare(goal_return, term_returns)
    assert update.objective == objective(update.weights[None]).item()
    assert update.baseline_objective == objective(torch.ones(1, NUM_TERMS)).item() > 0
    assert 0.0 <= update.optimal_share <= 1.0  # the last pack may have moved off the best


@pytest.mark.parametrize("choice", CHOICES)
def test_the_same_seed_gives_the_same_bits(choice: str) -> None:
    first, second = make(choice, seed=3), make(choice, seed=3)
    for iteration in range(2):
        assert same(asked(first, iteration), asked(second, iteration))


@pytest.mark.parametrize("choice", [c for c in CHOICES if c not in GRADIENTS])
def test_gradients_that_nobody_asks_for_are_not_computed(choice: str) -> None:
    def policy_gradients() -> PolicyGradients:
        raise AssertionError("they would cost time")

    optimizer = make(choice)
    optimizer.observe(
        TrainingProgress(50.0, 24, COSTS, goal_share=1.0, policy_gradients=policy_gradients)
    )
    optimizer.update(*returns(0))


@pytest.mark.parametrize("choice", [*SEARCHES, "random"])
def test_seeds_and_iterations_differ(choice: str) -> None:
    one, other = make(choice, seed=3), make(choice, seed=4)
    weights = [optimizer.search(uneven_bowl).position for optimizer in (one, one, other)]
    assert not torch.equal(weights[0], weights[1])
    assert not torch.equal(weights[0], weights[2])


@pytest.mark.parametrize(("choice", "settings"), VARIANTS)
def test_a_saved_optimizer_continues_bit_for_bit(
    choice: str, settings: dict[str, Any], tmp_path: Path
) -> None:
    alone = make(choice, seed=3, **settings)
    for iteration in range(2):
        asked(alone, iteration)
    torch.save(alone.state_dict(), tmp_path / "optimizer.pt")
    expected = [asked(alone, iteration) for iteration in (2, 3)]

    resumed = make(choice, seed=99, **settings)
    resumed.load_state_dict(torch.load(tmp_path / "optimizer.pt", weights_only=True))
    found = [asked(resumed, iteration) for iteration in (2, 3)]
    assert all(same(a, b) for a, b in zip(expected, found, strict=True))


@pytest.mark.parametrize("choice", CHOICES)
def test_a_saved_state_does_not_change_afterwards(choice: str) -> None:
    optimizer = make(choice)
    asked(optimizer, 0)
    state = optimizer.state_dict()
    before = {name: value.clone() for name, value in state.items()}
    update = asked(optimizer, 1)
    update.weights.zero_()
    assert all(torch.equal(state[name], before[name]) for name in before)
    assert set(state) == set(before)


@pytest.mark.parametrize(("choice", "settings"), VARIANTS)
def test_changing_the_returned_weights_does_not_reach_the_optimizer(
    choice: str, settings: dict[str, Any]
) -> None:
    touched, untouched = make(choice, seed=3, **settings), make(choice, seed=3, **settings)
    for iteration in range(3):
        one, other = asked(touched, iteration), asked(untouched, iteration)
        assert same(one, other)
        one.weights.zero_()
    saved = untouched.state_dict()
    assert all(torch.equal(value, saved[name]) for name, value in touched.state_dict().items())


@pytest.mark.parametrize("choice", CHOICES)
def test_the_global_generators_are_left_alone(choice: str) -> None:
    before = torch.get_rng_state(), np.random.get_state()[1].copy(), random.getstate()  # noqa: NPY002
    asked(make(choice), 0)
    assert torch.equal(torch.get_rng_state(), before[0])
    assert (np.random.get_state()[1] == before[1]).all()  # noqa: NPY002
    assert random.getstate() == before[2]


@pytest.mark.parametrize("choice", CHOICES)
def test_the_order_of_the_environments_does_not_matter(choice: str) -> None:
    goal_return, term_returns = returns(0)
    shuffled = torch.randperm(200, generator=torch.Generator().manual_seed(0))
    one = asked(make(choice), 0)
    other = asked(make(choice), 0, (goal_return[shuffled], term_returns[shuffled]))
    assert same(one, other)


@pytest.mark.parametrize("choice", CHOICES)
def test_returns_of_another_number_of_terms_are_refused(choice: str) -> None:
    with pytest.raises(ValueError, match=r"\(200, 4\), expected \[num_envs, 5\]"):
        make(choice).update(*returns(0, num_terms=4))


@pytest.mark.parametrize("choice", CHOICES)
def test_the_state_of_another_kind_of_optimizer_is_refused(choice: str) -> None:
    with pytest.raises(ValueError, match=r"another kind of optimizer"):
        make(choice).load_state_dict({"swarm": torch.zeros(1)})


@pytest.mark.parametrize("choice", [*SEARCHES, "random", "gradnorm", "meta_gradient"])
def test_the_state_for_another_number_of_terms_is_refused(choice: str) -> None:
    with pytest.raises(ValueError, match=r"shape \(4,\), this one has 5 terms"):
        make(choice).load_state_dict(make(choice, num_terms=4).state_dict())


@pytest.mark.parametrize("choice", BOXED)
@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"num_terms": 0}, "num_terms is 0: .*no optimizing terms"),
        ({"seed": -1}, "seed is -1; allowed: at least 0"),
        ({"lower": 1.0, "upper": 1.0}, r"lower 1\.0 and upper 1\.0 .* lower < upper"),
        ({"upper": float("inf")}, r"upper inf must be finite"),
        ({"lower": float("nan")}, r"lower nan"),
    ],
)
def test_bad_settings_are_refused(choice: str, settings: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        make(choice, **settings)


@pytest.mark.parametrize("choice", BOXED)
def test_weights_stay_within_other_bounds(choice: str) -> None:
    optimizer = make(choice, lower=0.25, upper=0.5)
    for iteration in range(2):
        weights = asked(optimizer, iteration).weights
        assert ((weights >= 0.25) & (weights <= 0.5)).all()


@pytest.mark.parametrize("choice", SEARCHES)
@pytest.mark.parametrize("num_terms", [1, 6, 30])
def test_a_search_spends_its_budget_within_the_box_and_keeps_the_best(
    choice: str, num_terms: int
) -> None:
    recorder = Recorder(uneven_bowl)
    found = make(choice, num_terms=num_terms).search(recorder)
    positions, values = torch.cat(recorder.packs), torch.cat(recorder.values)
    assert found.evaluations == recorder.calls
    if choice == "effective_dimension":  # the screening's rest is no multiple of the pack
        assert BUDGET - 30 < found.evaluations <= BUDGET
    else:
        assert found.evaluations == BUDGET
        assert found.value == values.min()
    assert ((positions >= 0.0) & (positions <= 1.0)).all()
    assert found.value == uneven_bowl(found.position[None]).item()
    assert (positions == found.position).all(dim=1).any()
    assert torch.equal(uneven_bowl(found.pack), found.pack_values)


@pytest.mark.parametrize("choice", [c for c in SEARCHES if c != "random_search"])
@pytest.mark.parametrize("num_terms", [6, 30])
def test_a_search_finds_better_than_chance(choice: str, num_terms: int) -> None:
    for seed in range(2):
        given = {"seed": seed, "num_terms": num_terms}
        learned = make(choice, **given).search(uneven_bowl).value
        by_chance = make("random_search", **given).search(uneven_bowl).value
        assert learned < 0.5 * by_chance


@pytest.mark.parametrize("choice", [c for c in SEARCHES if c != "effective_dimension"])
def test_of_equally_good_weights_the_tie_break_takes_its_own(choice: str) -> None:
    for tie_break in ("first", "largest_norm"):
        recorder = Recorder(plateau)
        found = make(choice, tie_break=tie_break).search(recorder)
        optimal = torch.cat(recorder.packs)[torch.cat(recorder.values) == 0.0]
        assert found.value == 0.0
        assert len(optimal) > 1
        if tie_break == "first":
            assert torch.equal(found.position, optimal[0])
        else:
            assert found.position.norm() == optimal.norm(dim=1).max()


@pytest.mark.parametrize("choice", SEARCHES)
def test_a_function_that_is_flat_is_searched_without_complaint(choice: str) -> None:
    found = make(choice).search(constant)
    assert found.value == 0.0
    assert found.optimal_share == 1.0


@pytest.mark.parametrize("choice", SEARCHES)
def test_a_value_that_is_not_a_number_stops_the_search(choice: str) -> None:
    with pytest.raises(ValueError, match="the objective is not a number at the weights"):
        make(choice).search(lambda x: constant(x) * float("nan"))


@pytest.mark.parametrize("choice", [c for c in SEARCHES if c != "effective_dimension"])
def test_a_search_fits_the_budget_it_is_given(choice: str) -> None:
    recorder = Recorder(uneven_bowl)
    make(choice, **setting_for(make(choice), 200)).search(recorder)
    assert 200 - 30 < recorder.calls <= 200
