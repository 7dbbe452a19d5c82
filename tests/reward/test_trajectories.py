"""What the search ranks: the sums of each reading by hand, and what they have in common."""

import pytest
import torch
from torch import Tensor

from tlr_exp.config.limits import RANKED
from tlr_exp.reward.trajectories import Steps, trajectories_of
from tlr_exp.training.episodes import EpisodeLengths


def steps_of(batches: list[tuple[list, list]], phase: float = 0.0) -> list[Steps]:
    """Batches of (terms [num_envs, num_steps], done) with one term, and ages as a training has."""
    lengths, made = EpisodeLengths(len(batches[0][0])), []
    for terms, done in batches:
        ended = torch.tensor(done, dtype=torch.bool)
        values = torch.tensor(terms)[..., None]
        made.append(Steps(values, ended, lengths.add(ended), torch.full(ended.shape, phase)))
    return made


def sums(reading: str, batches: list[Steps]) -> list[list[float]]:
    ranked = trajectories_of(reading)
    return [ranked(steps).sum(dim=1)[:, 0].tolist() for steps in batches]


# The first robot falls at step 2 of the second batch, and again at step 4; the second never.
TWO_BATCHES = steps_of(
    [
        ([[1.0, 2.0, 3.0, 4.0], [1.0, 1.0, 1.0, 1.0]], [[0, 0, 0, 0], [0, 0, 0, 0]]),
        ([[5.0, 6.0, 7.0, 8.0], [2.0, 2.0, 2.0, 2.0]], [[0, 1, 0, 1], [0, 0, 0, 0]]),
        ([[9.0, 1.0, 1.0, 1.0], [3.0, 3.0, 3.0, 3.0]], [[0, 0, 0, 0], [0, 0, 0, 0]]),
    ]
)


def test_a_segment_is_all_steps_of_the_iteration():
    assert sums("segment", TWO_BATCHES) == [[10.0, 4.0], [26.0, 8.0], [12.0, 12.0]]


def test_an_episode_counts_from_its_reset_to_its_end():
    # 10, then 10 + 5 + 6 up to the fall. What began and ended within the second batch (7 + 8) is
    # part of none; the third batch is an episode of its own.
    assert sums("episode", TWO_BATCHES) == [[10.0, 4.0], [21.0, 12.0], [12.0, 24.0]]


def test_per_step_it_is_the_mean_of_the_episode():
    expected = [[10 / 4, 1.0], [21 / 6, 12 / 8], [12 / 4, 24 / 12]]
    assert sums("per_step", TWO_BATCHES) == [pytest.approx(each) for each in expected]


def test_what_follows_an_end_belongs_to_the_episode_of_the_next_iteration():
    batches = steps_of([([[1.0, 2.0, 3.0]], [[0, 1, 0]]), ([[4.0, 5.0, 6.0]], [[0, 0, 1]])])
    assert sums("episode", batches) == [[3.0], [3.0 + 15.0]]


def test_matched_by_age_a_step_is_compared_with_its_like():
    # Ages 1 and 2 are alike, and the phase is one: what is left are the differences from the mean.
    (steps,) = steps_of([([[1.0, 3.0], [5.0, 7.0]], [[0, 0], [0, 0]])])
    left = trajectories_of("age_matched")(steps)[..., 0]
    assert left.tolist() == [[-3.0, -1.0], [1.0, 3.0]]


def random_steps(seed: int = 0) -> Steps:
    generator = torch.Generator().manual_seed(seed)

    def draw(*shape: int) -> Tensor:
        return torch.rand(64, 24, *shape, generator=generator)

    done = draw() < 0.05
    return Steps(draw(3), done, EpisodeLengths(64).add(done), draw())


def test_matched_by_age_no_cell_is_better_than_another():
    """Where a reward depends on age and phase alone, all returns are 0."""
    steps = random_steps()
    band = (steps.age > 6).float() + 2.0 * (steps.phase >= 0.5).float()
    alone = Steps(band[..., None], steps.done, steps.age, steps.phase)
    assert trajectories_of("age_matched")(alone).abs().max() < 1e-6
    assert trajectories_of("age_matched")(steps).sum(dim=(0, 1)).abs().max() < 1e-4


@pytest.mark.parametrize("reading", RANKED)
def test_every_reading_is_linear_in_the_terms_so_that_one_search_fits_all(reading):
    steps, weights = random_steps(), torch.tensor([1.0, -0.5, 0.25])
    together = Steps((steps.terms @ weights)[..., None], steps.done, steps.age, steps.phase)
    apart = trajectories_of(reading)(steps).sum(dim=1) @ weights
    whole = trajectories_of(reading)(together).sum(dim=1)[:, 0]
    torch.testing.assert_close(apart, whole, rtol=1e-5, atol=1e-5)


@pytest.mark.parametrize("reading", RANKED)
def test_a_reading_continues_bit_for_bit_and_its_saved_state_stays(reading):
    alone, batches = trajectories_of(reading), [random_steps(seed) for seed in range(3)]
    alone(batches[0])
    state = alone.state_dict()
    before = {name: value.clone() for name, value in state.items()}
    expected = [alone(each) for each in batches[1:]]
    resumed = trajectories_of(reading)
    resumed.load_state_dict(state)
    assert all(torch.equal(resumed(b), e) for b, e in zip(batches[1:], expected, strict=True))
    assert all(torch.equal(state[name], before[name]) for name in before)
