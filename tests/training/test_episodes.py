"""Episode lengths over batches, by hand."""

import copy
import math

import pytest
import torch

from tlr_exp.keys import Ending
from tlr_exp.training.episodes import AGE_BANDS, EpisodeLengths, ending_shares, mean_at_equal_ages


def done(*rows: str) -> torch.Tensor:
    """[num_envs, num_steps]; ``x`` where an episode ends."""
    return torch.tensor([[mark == "x" for mark in row] for row in rows])


def test_two_batches_by_hand():
    episodes = EpisodeLengths(num_envs=3)
    # First batch: lengths 2 and 1 in the first environment, 3 in the third.
    episodes.add(done(".xx.", "....", "..x."))
    assert sorted(episodes.last) == [1, 2, 3]
    assert episodes.mean_length == pytest.approx(2.0)
    # Second batch: 1 + 1 = 2 in the first; 4 + 4 = 8 in the second; the third goes on.
    episodes.add(done("x...", "...x", "...."))
    assert sorted(episodes.last) == [1, 2, 2, 3, 8]
    assert episodes.mean_length == pytest.approx(16 / 5)
    assert episodes.running.tolist() == [3, 0, 5]


def test_the_age_of_a_step_counts_from_its_reset():
    episodes = EpisodeLengths(num_envs=2)
    assert episodes.add(done(".xx.", "....")).tolist() == [[1, 2, 1, 1], [1, 2, 3, 4]]
    assert episodes.add(done("x...", "...x")).tolist() == [[2, 1, 2, 3], [5, 6, 7, 8]]


def test_every_half_second_counts_alike_however_many_robots_are_in_it():
    age = torch.tensor([1, 25, 2, 26, 51, 100])
    error = torch.tensor([0.1, 0.3, 0.2, 0.4, 0.6, 0.8])  # means 0.2, 0.4, 0.6, 0.8
    assert mean_at_equal_ages(error[None], age[None]) == pytest.approx(0.5)


def test_later_steps_do_not_count_and_missing_ones_leave_no_mean():
    age = torch.tensor([[10, 30, 60, 90, 101]])
    error = torch.tensor([[1.0, 1.0, 1.0, 1.0, 9.0]])
    assert mean_at_equal_ages(error, age) == pytest.approx(1.0)
    assert math.isnan(mean_at_equal_ages(error[:, :3], age[:, :3]))


def test_an_error_that_only_grows_with_age_is_the_same_for_long_and_for_short_episodes():
    def standardised(length: int) -> tuple[float, float]:
        age = torch.arange(1200).reshape(1, -1) % length + 1
        error = 0.001 * age
        return mean_at_equal_ages(error, age), error.mean().item()

    (short, short_mean), (long, long_mean) = standardised(100), standardised(200)
    assert short == pytest.approx(long)
    assert long_mean > 1.5 * short_mean
    assert AGE_BANDS[-1][1] == 100


def test_before_any_episode_has_ended_the_running_ones_count():
    episodes = EpisodeLengths(num_envs=2)
    assert episodes.mean_length == 0.0
    episodes.add(done("...", "..."))
    assert episodes.mean_length == 3.0


def test_only_the_last_episodes_count():
    episodes = EpisodeLengths(num_envs=1, window=3)
    episodes.add(done("x.x..x...x"))  # 1, 2, 3, 4
    assert list(episodes.last) == [2, 3, 4]
    assert episodes.mean_length == 3.0


def test_state_goes_on_where_it_was_saved():
    episodes = EpisodeLengths(num_envs=2, window=2)
    episodes.add(done("x..x.", "....."))
    saved = episodes.state_dict()
    kept = copy.deepcopy(saved)
    episodes.add(done("..x", "x.."))
    # Going on does not reach into what was saved.
    assert torch.equal(saved["running"], kept["running"])
    assert saved["last"] == kept["last"] == [1, 3]

    other = EpisodeLengths(num_envs=2, window=2)
    other.load_state_dict(saved)
    other.add(done("..x", "x.."))
    assert other.mean_length == episodes.mean_length == (6 + 4) / 2
    assert torch.equal(other.running, episodes.running)
    assert torch.equal(saved["running"], kept["running"])


def test_how_episodes_end_by_hand():
    # Of five that end: two at the motion's end, one by a fall, one too far off, one unstable.
    truncated = done("...x", "x...", "....")
    terminated = done(".x..", "..x.", "..x.")
    fell = done(".x..", "x...", ".xxx")  # a fall that ends nothing is no ending
    unstable = done("....", "....", "..x.")
    assert ending_shares(terminated, truncated, fell, unstable) == {
        Ending.COMPLETED: pytest.approx(2 / 5),
        Ending.FELL: pytest.approx(1 / 5),
        Ending.TOO_FAR: pytest.approx(1 / 5),
        Ending.UNSTABLE: pytest.approx(1 / 5),
    }


def test_where_no_episode_ends_there_are_no_shares():
    none = done("....")
    assert all(math.isnan(share) for share in ending_shares(none, none, none, none).values())
