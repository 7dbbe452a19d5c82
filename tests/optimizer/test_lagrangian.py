"""Multipliers that hold costs at their limits: steps by hand, and problems with known answers."""

import pytest
import torch
from configured import make
from hydra import compose, initialize_config_module

from tlr_exp.config.load import ConfigError, load_settings, plain_config, with_absolute_paths
from tlr_exp.optimizer.lagrangian import LagrangianWeights
from tlr_exp.optimizer.protocol import TrainingProgress
from tlr_exp.records.run_directory import RunDirectory
from tlr_exp.reward.objectives import RankDeviation
from tlr_exp.training.run import check_lower_layer

OBJECTIVE = RankDeviation(0.34)
RETURNS = (torch.tensor([3.0, 2.0, 1.0]), torch.zeros(3, 2))


def optimizer(**settings) -> LagrangianWeights:
    """Limits 0.5 and 2.0, unless others are given, and none of those of the file."""
    limits = {"ang_vel_xy": 0.5, "lin_vel_z": 2.0}
    settings = {"limits": limits, "integral_gain": 0.1, **settings}
    return make("lagrangian", "~optimizer.limits", num_terms=2, objective=OBJECTIVE, **settings)


def told(made: LagrangianWeights, *costs: tuple[float, float]) -> list[float]:
    for ang_vel_xy, lin_vel_z in costs:
        terms = {"ang_vel_xy": ang_vel_xy, "lin_vel_z": lin_vel_z}
        made.observe(TrainingProgress(100.0, 24, terms))
    return made.update(*RETURNS).weights.tolist()


def test_before_any_cost_is_known_it_is_the_static_reward():
    assert told(optimizer()) == [1.0, 1.0]


def test_dual_ascent_by_hand():
    # Twice the limit: 1 + 0.1 (2 - 1). Half of it: 1 + 0.1 (0.5 - 1).
    assert told(optimizer(), (1.0, 1.0)) == pytest.approx([1.1, 0.95])
    # At the limit nothing moves; three times the limit: + 0.2.
    assert told(optimizer(), (1.0, 1.0), (0.5, 6.0)) == pytest.approx([1.1, 1.15])


def test_multipliers_stay_within_their_bounds_and_come_back_at_once():
    made = optimizer(integral_gain=1.0, largest=3.0)
    assert told(made, (50.0, 0.0)) == [3.0, 0.0]
    assert told(made, (0.25, 4.0)) == pytest.approx([2.5, 1.0])


def test_controller_by_hand():
    made = optimizer(proportional_gain=0.5, derivative_gain=0.25)
    # I = 1.1 and 0.95; + 0.5 e with e = 1 and -0.5; the first costs tell of no rise.
    assert told(made, (1.0, 1.0)) == pytest.approx([1.6, 0.7])
    # e = 3 and -0.75: I = 1.4 and 0.875. A rise by 1.0, two limits; a fall counts as none.
    assert told(made, (2.0, 0.5)) == pytest.approx([1.4 + 1.5 + 0.5, 0.875 - 0.375])


def test_a_term_without_a_limit_keeps_the_weight_of_the_static_reward():
    made = optimizer(limits={"lin_vel_z": 2.0, "torques": 1.0}, integral_gain=0.5)
    assert told(made, (100.0, 0.0), (100.0, 0.0)) == [1.0, 0.0]


@pytest.mark.parametrize(
    "gains", [{}, {"proportional_gain": 0.5, "derivative_gain": 0.5}], ids=["ascent", "pid"]
)
def test_costs_of_a_toy_problem_converge_to_their_limits(gains):
    """A learner that gives way, c = 1 / (1 + a w): the limit d asks for w = (1 / d - 1) / a."""
    strength = torch.tensor([0.5, 4.0], dtype=torch.float64)
    limits = {"ang_vel_xy": 0.25, "lin_vel_z": 0.1}
    made = optimizer(limits=limits, largest=50.0, **gains)
    weights = torch.ones(2, dtype=torch.float64)
    for _ in range(4000):
        costs = 1.0 / (1.0 + strength * weights)
        weights = torch.tensor(told(made, tuple(costs.tolist())), dtype=torch.float64)
    assert costs.tolist() == pytest.approx([0.25, 0.1], rel=1e-3)
    assert weights.tolist() == pytest.approx([6.0, 2.25], rel=1e-3)


def test_a_limit_that_is_not_reached_costs_nothing():
    made = optimizer()
    told(made, *[(0.4, 1.9)] * 400)
    assert told(made) == [0.0, 0.0]


def test_it_goes_on_to_the_same_bits():
    gains = {"proportional_gain": 0.3, "derivative_gain": 0.7}
    costs = [(0.9, 1.0), (0.3, 7.0), (0.8, 2.0), (1.3, 0.1)]
    whole, first, second = (optimizer(**gains) for _ in range(3))
    told(first, *costs[:2])
    second.load_state_dict(first.state_dict())
    assert told(second, *costs[2:]) == told(whole, *costs)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"limits": {"ang_vel_xy": 0.0}}, r"limits\.ang_vel_xy is 0\.0; allowed: above 0"),
        ({"integral_gain": -1.0}, r"integral_gain is -1\.0; allowed: at least 0"),
        ({"initial": 11.0}, r"initial is 11\.0; allowed: from 0 to 10"),
    ],
)
def test_bad_settings_are_refused(settings, message):
    with pytest.raises(ValueError, match=message):
        optimizer(**settings)


def test_costs_that_do_not_fit_are_refused():
    with pytest.raises(ValueError, match=r"costs of \['ang_vel_xy'\], but 2 multipliers"):
        optimizer().observe(TrainingProgress(100.0, 24, {"ang_vel_xy": 1.0}))


# --- the configuration -----------------------------------------------------------------------


@pytest.mark.parametrize(
    ("override", "message"),
    [
        ("+optimizer.limits.body_pos=1.0", "optimizer.limits.body_pos is no term of the lower"),
        ("optimizer.limits.ang_vel_xy=-1.0", r"^optimizer.*ang_vel_xy .* above 0"),
    ],
)
def test_a_wrong_limit_is_refused_by_its_key(settings_of, override, message):
    with pytest.raises(ConfigError, match=message):
        check_lower_layer(settings_of("optimizer=lagrangian", override))


def configured(*overrides: str) -> dict:
    with initialize_config_module("tlr_exp.conf", version_base="1.3"):
        return plain_config(compose("config", ["optimizer=lagrangian", *overrides]))


@pytest.fixture
def reference_run(tmp_path):
    """Ten iterations; the costs of the last two are 3 and 5, and one that is never above 0."""
    run = RunDirectory.create(tmp_path / "reference", {"seed": 0}, {})
    for iteration in range(1, 11):
        cost = {9: 3.0, 10: 5.0}.get(iteration, 100.0)
        terms = {"ang_vel_xy": cost, "dof_vel_limits": 0.0, "body_pos": 0.9}
        run.log(iteration, {f"reward_term/{name}": value for name, value in terms.items()})
    run.flush()
    return run.path


def test_limits_are_the_costs_at_the_end_of_a_reference_run(reference_run):
    overrides = [f"optimizer.reference={reference_run}", "optimizer.reference_share=0.5"]
    config = configured(*overrides)
    resolved = with_absolute_paths(config)["optimizer"]
    assert resolved["limits"] == {"ang_vel_xy": pytest.approx(2.0)}
    assert resolved["reference"] is None
    assert resolved["reference_share"] == 1.0  # already taken


def test_a_reference_that_is_no_run_is_refused(tmp_path):
    with pytest.raises(ConfigError, match=r"optimizer\.reference: .*none"):
        with_absolute_paths(configured(f"optimizer.reference={tmp_path}/none"))


def nested(around: str, *overrides: str) -> dict:
    inside = [f"optimizer={around}", "optimizer@optimizer.inner=lagrangian"]
    with initialize_config_module("tlr_exp.conf", version_base="1.3"):
        return plain_config(compose("config", [*inside, *overrides]))


@pytest.mark.parametrize("around", ["smoothed", "staged", "under_curriculum", "when_tracking"])
def test_limits_inside_another_optimizer_are_as_good_as_alone(around, reference_run, tmp_path):
    config = nested(around, f"optimizer.inner.reference={reference_run}")
    resolved = with_absolute_paths(config)["optimizer"]
    assert resolved["inner"]["limits"] == {"ang_vel_xy": pytest.approx(4.0)}
    assert resolved["inner"]["reference"] is None
    assert {**resolved, "inner": None} == {**config["optimizer"], "inner": None}
    with pytest.raises(ConfigError, match=r"optimizer\.inner\.reference: .*none"):
        with_absolute_paths(nested(around, f"optimizer.inner.reference={tmp_path}/none"))
    share = nested(around, f"optimizer.inner.reference={reference_run}")
    share["optimizer"]["inner"]["reference_share"] = 0.0
    with pytest.raises(ConfigError, match=r"optimizer\.inner\.reference_share is 0"):
        with_absolute_paths(share)


def test_limits_two_optimizers_deep_are_checked_by_name():
    config = nested("smoothed")
    config["optimizer"]["inner"] = nested("when_tracking")["optimizer"]
    assert load_settings(config)
    config["optimizer"]["inner"]["inner"]["limits"] = {"body_pos": 1.0}
    with pytest.raises(ConfigError, match=r"optimizer\.inner\.inner\.limits\.body_pos is no term"):
        load_settings(config)


def test_a_reference_that_has_no_costs_is_refused(tmp_path):
    run = RunDirectory.create(tmp_path / "fresh", {"seed": 0}, {})
    with pytest.raises(ConfigError, match="fresh has recorded no lower-layer cost yet"):
        with_absolute_paths(configured(f"optimizer.reference={run.path}"))


@pytest.mark.parametrize("share", ["abc", "0", "-1", "null"])
def test_a_share_that_cannot_be_is_refused_before_limits_are_made_of_it(reference_run, share):
    overrides = [f"optimizer.reference={reference_run}", f"optimizer.reference_share={share}"]
    with pytest.raises(ConfigError, match=r"^optimizer\.reference_share is .*; allowed: above 0$"):
        with_absolute_paths(configured(*overrides))
