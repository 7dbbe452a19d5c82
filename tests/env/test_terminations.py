"""Failures at their thresholds, and the curriculum of the distance limit by hand."""

import math

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from tlr_exp.config.settings import TerminationSettings
from tlr_exp.env.terminations import TighteningDistance, far_from_reference, fell

CPU = torch.device("cpu")


def limits(**changes: float | None) -> TerminationSettings:
    values = {
        "max_tilt": 0.8,
        "distance_start_m": 1.6,
        "distance_end_m": 0.4,
        "distance_max_m": None,
        "tighten_rate": 0.5,
        "tighten_above_steps": 42.0,
        "loosen_below_steps": 40.0,
        "mean_episodes": None,
    }
    return TerminationSettings(**{**values, **changes})


def test_by_the_letter_of_asap_the_limit_loosens_further_and_more_episodes_count():
    limit = TighteningDistance(limits(distance_max_m=3.0, mean_episodes=10), num_envs=2, device=CPU)
    lengths = torch.tensor([20, 40])
    limit.update(lengths, torch.tensor([True, True]))
    assert limit.mean_length.item() == pytest.approx(6.0)  # 2/10 of the way from 0 to 30
    assert limit.value_m.item() == pytest.approx(2.4)
    limit.update(lengths, torch.tensor([False, False]))
    assert limit.value_m.item() == pytest.approx(3.0)  # and no further


def test_a_mean_of_fewer_episodes_than_end_at_once_is_theirs():
    limit = TighteningDistance(limits(mean_episodes=1), num_envs=2, device=CPU)
    limit.update(torch.tensor([20, 40]), torch.tensor([True, True]))
    assert limit.mean_length.item() == pytest.approx(30.0)


def test_a_limit_that_is_held_does_not_move_until_it_is_released():
    limit = TighteningDistance(limits(), num_envs=1, device=CPU)
    long, done = torch.tensor([100]), torch.tensor([True])
    limit.hold(0.9)
    limit.update(long, done)
    assert limit.value_m.item() == pytest.approx(0.9)
    assert limit.mean_length.item() == 100.0  # it is counted meanwhile
    limit.hold(None)
    limit.update(long, done)
    assert limit.value_m.item() == pytest.approx(0.45)  # tightened by half from there


# --- single failures -------------------------------------------------------------------------


@pytest.mark.parametrize("axis", [(1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0)])
@pytest.mark.parametrize("heading", [0.0, 2.5])
def test_a_fall_begins_where_the_sine_of_roll_or_pitch_passes_the_limit(axis, heading, tracking):
    step = tracking(2)
    for env, angle in enumerate((math.asin(0.8) - 1e-3, math.asin(0.8) + 1e-3)):
        tilt = Rotation.from_rotvec(angle * torch.tensor(axis).double().numpy())
        pose = Rotation.from_rotvec([0.0, 0.0, heading]) * tilt
        step.state.qpos[env, 3:7] = torch.tensor(pose.as_quat(scalar_first=True))
    assert fell(step.instant, max_tilt=0.8).tolist() == [False, True]


def test_one_body_beyond_the_distance_is_enough(tracking):
    step = tracking(4)
    # 0.5 m exactly: (0.3, 0, 0.4). A step of 1e-3 m either way decides.
    offset = torch.tensor([0.3, 0.0, 0.4])
    for env, scale in enumerate((0.0, 0.998, 1.002, 5.0)):
        step.state.body_pos_w[env, 17] += scale * offset
    found = far_from_reference(step.instant, 0.5)
    assert found.tolist() == [False, False, True, True]
    as_tensor = far_from_reference(step.instant, torch.tensor(0.5))
    assert torch.equal(as_tensor, found)


def test_distances_of_several_bodies_do_not_add_up(tracking):
    step = tracking()
    step.state.body_pos_w.add_(torch.tensor([0.0, 0.49, 0.0]))
    assert far_from_reference(step.instant, 0.5).tolist() == [False]


# --- the tightening limit --------------------------------------------------------------------


def finish(distance: TighteningDistance, *lengths: float) -> None:
    """One control step in which episodes of these lengths end, one an environment; 0: none."""
    steps = torch.tensor(lengths)
    distance.update(steps, steps > 0)


def test_mean_episode_length_by_hand():
    distance = TighteningDistance(limits(), num_envs=4, device=CPU)
    # Two of four end, 20 steps on average: 0 + (20 - 0) * 2/4 = 10.
    finish(distance, 10, 0, 30, 0)
    assert distance.mean_length.item() == 10.0
    finish(distance, 0, 0, 0, 0)
    assert distance.mean_length.item() == 10.0
    # One ends after 50 steps: 10 + (50 - 10)/4 = 20.
    finish(distance, 0, 50, 0, 0)
    assert distance.mean_length.item() == 20.0
    # All end: only they count.
    finish(distance, 1, 2, 3, 2)
    assert distance.mean_length.item() == 2.0


def test_limit_descends_by_its_rate_with_long_episodes_and_stays_at_its_end():
    # (1 - 0.01)^138 = 0.2498: from 1.6 m to just below a quarter of it in 138 steps.
    distance = TighteningDistance(limits(tighten_rate=0.01), num_envs=1, device=CPU)
    values = []
    for _ in range(138):
        finish(distance, 100)
        values.append(distance.value_m.item())
    assert values[0] == pytest.approx(1.584)
    # (1 - 0.01)^69 = 0.4998: half way.
    assert values[68] == pytest.approx(0.8, rel=2e-3)
    assert values == sorted(values, reverse=True)
    assert values[-1] == pytest.approx(0.4)
    finish(distance, 100)
    assert distance.value_m.item() == pytest.approx(0.4)


def test_asaps_rate_reaches_the_end_after_64000_steps(settings_of):
    termination = settings_of().env.termination
    steps = math.log(termination.distance_end_m / termination.distance_start_m) / math.log1p(
        -termination.tighten_rate
    )
    assert round(steps, -3) == 64_000


def test_limit_stays_at_its_start_while_episodes_are_short():
    distance = TighteningDistance(limits(), num_envs=1, device=CPU)
    for _ in range(5):
        finish(distance, 12)
        assert distance.value_m.item() == pytest.approx(1.6)


def test_limit_grows_back_when_episodes_become_short_and_rests_in_between():
    # Each step down halves the limit, each step up takes it by 1 + 0.5.
    distance = TighteningDistance(limits(), num_envs=1, device=CPU)
    expected = [(50, 0.8), (41, 0.8), (40, 0.8), (42, 0.8), (39, 1.2), (39, 1.6), (43, 0.8)]
    for length, value in expected:
        finish(distance, length)
        assert distance.value_m.item() == pytest.approx(value)


@given(st.lists(st.integers(1, 100), min_size=1, max_size=30))
def test_limit_never_leaves_its_bounds(lengths):
    distance = TighteningDistance(limits(), num_envs=1, device=CPU)
    for length in lengths:
        finish(distance, length)
        assert 0.4 - 1e-6 <= distance.value_m.item() <= 1.6 + 1e-6


def test_saved_limit_goes_on_bit_for_bit_and_later_steps_leave_it():
    distance, other = (TighteningDistance(limits(), 3, CPU) for _ in range(2))
    generator = torch.Generator().manual_seed(0)

    def advance(*targets: TighteningDistance) -> None:
        lengths = torch.randint(60, (3,), generator=generator)
        for target in targets:
            target.update(lengths, lengths > 20)

    for _ in range(20):
        advance(distance)
    saved = distance.state_dict()
    kept = {name: value.clone() for name, value in saved.items()}
    other.load_state_dict(saved)
    for _ in range(20):
        advance(distance, other)
        assert torch.equal(distance.value_m, other.value_m)
        assert torch.equal(distance.mean_length, other.mean_length)
    assert all(torch.equal(saved[name], kept[name]) for name in kept)
    assert not torch.equal(distance.mean_length, kept["mean_length"])
