"""What a training says of the next scale, by hand arithmetic."""

import pytest

from tlr_exp.training.next_scale import (
    ITERATION_S,
    about,
    known_scales,
    next_scale,
    next_step,
    seconds_per_step,
)


def rows(*seconds: float) -> list[dict[str, float]]:
    return [{ITERATION_S: value} for value in seconds]


def test_scales_are_ordered_by_control_steps(settings_of):
    def after(*overrides):
        found = next_scale(settings_of(*overrides).scale, known_scales())
        return None if found is None else found["name"]

    assert after("scale=demo") == "laptop"
    assert after("scale=laptop") == "paper"
    assert after("scale=paper") is None


def test_the_next_of_several_is_the_nearest(settings_of):
    scale = settings_of("scale=demo").scale  # 256 x 24
    sizes = {"demo": (256, 24), "wide": (4096, 10), "long": (32, 200), "small": (8, 8)}
    known = [{"name": n, "num_envs": e, "iterations": i} for n, (e, i) in sizes.items()]
    assert next_scale(scale, known)["name"] == "long"  # 6,400 after 6,144; wide has 40,960


@pytest.mark.parametrize(
    "custom", [["scale.num_envs=64"], ["scale.iterations=25"], ["scale.name=mine"]]
)
def test_nothing_is_known_of_a_scale_of_ones_own(settings_of, custom):
    assert next_step(settings_of(*custom), rows(1.0), custom) is None


def test_a_step_takes_the_median_of_the_later_iterations():
    # The later half is 2, 2.5, 9: slow first iterations and an evaluation at the end do not count.
    assert seconds_per_step([30.0, 4.0, 2.0, 2.0, 2.5, 9.0], 1000) == pytest.approx(0.0025)
    assert seconds_per_step([5.0], 10) == 0.5


def test_minutes_are_those_of_the_next_scale_at_this_pace(settings_of):
    settings = settings_of("scale=demo")
    # 256 x 24 steps in 2 s; laptop has 512 x 24 x 407: 814 times as many, 1628 s.
    text = next_step(settings, rows(9.0, 2.0, 2.0), ["seed=1", "scale=demo", "optimizer=fixed"])
    assert text is not None
    assert text.startswith("tlr-train seed=1 optimizer=fixed scale=laptop  (about 27 min on this")
    assert text.endswith(settings_of("scale=laptop").scale.evidence)


def test_the_papers_scale_needs_a_gpu(settings_of):
    settings = settings_of("scale=laptop")
    text = next_step(settings, rows(4.0), ["scale=laptop", "physics.num_threads=1", "seed=2"])
    assert text is not None
    assert text.startswith("tlr-train seed=2 scale=paper physics=mjx device=cuda  (needs an NVIDIA")
    assert " min " not in text.partition(":")[0]


def test_on_a_gpu_the_papers_scale_is_reckoned_like_any_other(settings_of):
    settings = settings_of("scale=laptop", "physics=mjx", "device=cuda")
    # 512 steps x 24 in 0.1 s; the paper's 4096 x 2500 x 24 is 20,000 times that: 2000 s.
    text = next_step(settings, rows(0.1), ["scale=laptop", "physics=mjx", "device=cuda"])
    assert text is not None
    assert "physics=mjx device=cuda scale=paper  (about 33 min on this machine)" in text


@pytest.mark.parametrize(
    ("seconds", "text"),
    [(50.4, "50 s"), (89.0, "89 s"), (95.0, "2 min"), (7199, "120 min"), (18000, "5 h")],
)
def test_times_are_told_to_the_digit_that_is_known(seconds, text):
    assert about(seconds) == f"about {text}"
