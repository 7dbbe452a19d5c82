"""Where episodes start: probabilities by hand, their bounds, and the draws themselves."""

import pytest
import torch
from scipy import stats

from tlr_exp.env.starts import AVERAGING_RATE, UNIFORM_SHARE, StartFrames, even_frames

CPU = torch.device("cpu")


def adaptive(num_starts: int = 200) -> StartFrames:
    """Four bins of 50 frames: a second each."""
    return StartFrames("adaptive", num_starts, 50.0, CPU)


def fail_at(made: StartFrames, *frames: int) -> None:
    made.update(torch.tensor(frames), torch.ones(len(frames), dtype=torch.bool))


def generator(seed: int = 0) -> torch.Generator:
    return torch.Generator().manual_seed(seed)


# --- probabilities ---------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("num_starts", "sizes"),
    # 75 frames are 1.5 s, which makes two bins; 74 still make one.
    [
        (1, [1]),
        (39, [39]),
        (74, [74]),
        (75, [37, 38]),
        (200, [50] * 4),
        (249, [49, 50, 50, 50, 50]),
    ],
)
def test_bins_of_about_a_second_share_the_frames(num_starts, sizes):
    expected = torch.tensor(sizes) / num_starts
    torch.testing.assert_close(adaptive(num_starts).probabilities(), expected)


def test_even_before_any_failure():
    made = adaptive()
    made.update(torch.tensor([0, 60, 199]), torch.zeros(3, dtype=torch.bool))
    assert made.probabilities().tolist() == pytest.approx([0.25] * 4)


def test_a_failure_raises_its_bin_and_those_before_it_by_hand():
    made = adaptive()
    fail_at(made, 149)
    # 1, 0.8, 0.64 of 2.44 for the bins 2, 1, 0; a tenth is shared by all four.
    caused = [0.9 * weight / 2.44 for weight in (0.64, 0.8, 1.0, 0.0)]
    assert made.probabilities().tolist() == pytest.approx([0.025 + share for share in caused])


def test_failures_add_up_and_old_ones_fade():
    made = adaptive()
    fail_at(made, 0, 10)
    for _ in range(500):
        made.update(torch.tensor([0]), torch.tensor([False]))
    fail_at(made, 199)
    old, new = 2 * AVERAGING_RATE * (1 - AVERAGING_RATE) ** 501, AVERAGING_RATE
    assert made.failures.tolist() == pytest.approx([old, 0.0, 0.0, new], rel=1e-4)
    caused = [old, 0.64 * new, 0.8 * new, new]
    expected = [0.025 + 0.9 * share / sum(caused) for share in caused]
    assert made.probabilities().tolist() == pytest.approx(expected, rel=1e-4)


def test_a_failure_beyond_the_last_start_counts_for_the_last_bin():
    made = adaptive()
    fail_at(made, 203)
    assert made.failures.tolist() == pytest.approx([0.0, 0.0, 0.0, AVERAGING_RATE])


def test_fewer_bins_than_the_kernel_has():
    made = adaptive(100)
    fail_at(made, 99)
    caused = [0.9 * weight / 1.8 for weight in (0.8, 1.0)]
    assert made.probabilities().tolist() == pytest.approx([0.05 + share for share in caused])


@pytest.mark.parametrize("scale", [1.0, 1e-30, 1e-44, 1e30])
def test_no_bin_falls_below_its_even_share(scale):
    made = adaptive(497)
    even = made.probabilities()
    made.failures = scale * torch.tensor([0.0, 5.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0])
    found = made.probabilities()
    assert (found >= UNIFORM_SHARE * even * (1 - 1e-6)).all()
    assert found.sum().item() == pytest.approx(1.0, abs=1e-6)


def test_the_average_spans_about_a_thousand_control_steps():
    """A constant stream of failures is then taken in up to 1 - 1/e."""
    made = adaptive()
    for _ in range(1000):
        fail_at(made, 0)
    assert made.failures[0].item() == pytest.approx(0.632, abs=1e-3)


# --- draws -----------------------------------------------------------------------------------


def test_draws_have_the_stated_distribution():
    made = adaptive(230)  # bins of 46 frames
    fail_at(made, 100, 101, 229)
    probability = made.probabilities()
    frames = made.draw(46_000, generator(3))
    counts = torch.bincount(frames, minlength=230)
    assert len(counts) == 230
    expected = probability.repeat_interleave(46) / 46 * 46_000
    # Over single frames, so that the draws within a bin are tested, too.
    assert stats.chisquare(counts.numpy(), expected.double().numpy(), sum_check=False).pvalue > 0.01


def test_same_generator_same_frames():
    made = adaptive()
    fail_at(made, 120)
    first, again, other = (made.draw(50, generator(seed)) for seed in (1, 1, 2))
    assert torch.equal(first, again)
    assert not torch.equal(first, other)


def test_even_frames_begin_at_zero():
    assert even_frames(39, 1, "--starts") == [0]
    assert even_frames(40, 4, "--starts") == [0, 10, 20, 30]
    assert even_frames(39, 39, "--starts") == list(range(39))
    with pytest.raises(ValueError, match="--starts is 40; the motion has only 39 steps"):
        even_frames(39, 40, "--starts")


def test_random_and_zero_draw_as_ever_and_learn_nothing():
    made = StartFrames("random", 200, 50.0, CPU)
    fail_at(made, 120)
    expected = torch.randint(200, (30,), generator=generator(4))
    assert torch.equal(made.draw(30, generator(4)), expected)
    zero, unused = StartFrames("zero", 200, 50.0, CPU), generator(4)
    fail_at(zero, 120)
    assert zero.draw(3, unused).tolist() == [0, 0, 0]
    assert torch.equal(unused.get_state(), generator(4).get_state())
    assert not made.failures.any()
    assert not zero.failures.any()


# --- checkpoints -----------------------------------------------------------------------------


def test_a_restored_one_goes_on_with_the_same_bits():
    made, fresh = adaptive(), adaptive()
    fail_at(made, 120, 10)
    saved = made.state_dict()
    kept = saved["failures"].clone()
    fresh.load_state_dict(saved)
    for each in (made, fresh):
        fail_at(each, 60)
    assert torch.equal(made.failures, fresh.failures)
    assert torch.equal(made.draw(40, generator()), fresh.draw(40, generator()))
    assert torch.equal(saved["failures"], kept)


def test_another_motion_s_failures_are_refused():
    with pytest.raises(ValueError, match="have 4 bins, this motion has 2"):
        adaptive(100).load_state_dict(adaptive(200).state_dict())


# --- a part of the motion --------------------------------------------------------------------


@pytest.mark.parametrize(
    ("phases", "expected"),
    [([0.0, 0.0], {0}), ([0.25, 0.5], {5, 6, 7, 8, 9}), ([1.0, 1.0], {19}), (None, set(range(20)))],
)
def test_starts_keep_within_a_part_of_the_motion(phases, expected):
    starts = StartFrames("random", 20, 50.0, CPU)
    starts.keep_within([0.5, 0.6])
    starts.keep_within(phases)
    assert set(starts.draw(500, generator()).tolist()) == expected


def test_starts_anywhere_are_the_draws_that_they_were():
    drawn = StartFrames("random", 20, 50.0, CPU).draw(50, generator())
    assert torch.equal(drawn, torch.randint(20, (50,), generator=generator()))
