"""The numbers a run ends with, by hand."""

import math

import pytest

from tlr_exp.records.final_metrics import final_metrics


def lines(count: int, **metrics: object) -> list[dict]:
    """Lines 1 to `count`; a metric is a function of the iteration or the same number in all."""
    return [
        {
            "iteration": i,
            "wall_time": 1.0,
            **{
                name.replace("__", "/"): value(i) if callable(value) else value
                for name, value in metrics.items()
            },
        }
        for i in range(1, count + 1)
    ]


def test_mean_over_the_last_fifth() -> None:
    # Of 10 iterations the last 20 % are 9 and 10; of 24 those past 19.2: 20 to 24, mean 22.
    assert final_metrics(lines(10, train__episode_length=float)) == {"final/episode_length": 9.5}
    assert final_metrics(lines(24, train__episode_length=float)) == {"final/episode_length": 22.0}
    # (1 - 0.2) * 15 is 12.000000000000002 or 12: iteration 12 is out, 13 to 15 are in.
    assert final_metrics(lines(15, train__episode_length=float)) == {"final/episode_length": 14.0}
    assert final_metrics(lines(1, train__episode_length=3.0)) == {"final/episode_length": 3.0}


def test_every_measure_has_its_name() -> None:
    rows = lines(
        5,
        train__upper_body_error_m=0.2,
        train__lower_body_error_m=0.1,
        train__joint_error_rad=0.3,
        train__objective_after=1.0,
        weight__torque=1.0,
    )
    assert final_metrics(rows) == {
        "final/upper_body_error_m": pytest.approx(0.2),
        "final/lower_body_error_m": pytest.approx(0.1),
        "final/joint_error_rad": pytest.approx(0.3),
    }


def test_last_evaluation_counts_whenever_it_was() -> None:
    rows = lines(10)
    rows[3] |= {"eval/survival": 0.25, "eval/upright": 0.5}
    rows[7] |= {"eval/survival": 0.75, "eval/upright": math.nan}
    assert final_metrics(rows) == {"final/eval_survival": 0.75, "final/eval_upright": 0.5}


def test_iterations_without_a_value_count_neither_way() -> None:
    rows = lines(10, train__episode_length=lambda i: math.nan if i == 10 else float(i))
    assert final_metrics(rows) == {"final/episode_length": 9.0}
    assert final_metrics(lines(10, train__episode_length=math.nan)) == {}
    assert final_metrics([]) == {}


def test_numbers_are_rounded_to_nine_digits() -> None:
    rows = lines(5, train__episode_length=54.73999999999999, train__joint_error_rad=0.1 + 0.2)
    rows[-1]["eval/survival"] = 1 / 3e5
    assert final_metrics(rows) == {
        "final/episode_length": 54.74,
        "final/joint_error_rad": 0.3,
        "final/eval_survival": 3.33333333e-6,
    }
