"""The benchmark of learning recipes: what it trains, measures and stops."""

import json
import signal
from pathlib import Path

import numpy as np
import pytest
import yaml
from hydra import compose, initialize_config_module

from benchmarks.learning.curves import draw, load, read_curve, run_of, save
from benchmarks.learning.training import Job, judge
from benchmarks.learning.variants import Variant, load_variants
from tlr_exp.config.load import load_settings

VARIANTS = load_variants([])


@pytest.mark.parametrize("variant", VARIANTS, ids=lambda variant: variant.name)
def test_every_variant_is_a_valid_run_of_the_static_arm(variant: Variant) -> None:
    with initialize_config_module("tlr_exp.conf", version_base="1.3"):
        settings = load_settings(compose("config", list(variant.overrides)))
    assert settings.optimizer["_target_"].endswith("FixedWeights")
    assert settings.scale.name == "laptop"


def test_no_two_variants_are_the_same() -> None:
    assert len({variant.overrides for variant in VARIANTS}) == len(VARIANTS)


def test_a_variant_that_does_not_exist_is_refused_with_those_that_do() -> None:
    with pytest.raises(ValueError, match="no variant fats; there are fast, "):
        load_variants(["fast", "fats"])


def write_run(folder: Path, seed: int, terms: list[float], steps: float = 100.0) -> Path:
    """A run whose one goal term has these values in its iterations."""
    run = folder / f"laptop-fixed-seed{seed}-0123abcd"
    run.mkdir(parents=True)
    (run / "config.yaml").write_text(yaml.safe_dump({"reward": {"goal": {"body_pos": 2.0}}}))
    rows = [
        {
            "train/env_steps": 10.0 * (number + 1),
            "train/episode_length": steps,
            "train/upper_body_error_m": 0.1,
            "train/lower_body_error_m": 0.05,
            "time/iteration_s": 36.0,
            "reward_term/body_pos": term,
        }
        for number, term in enumerate(terms)
    ]
    lines = "".join(json.dumps(row) + "\n" for row in rows)
    (run / "metrics.jsonl").write_text(lines + '{"train/env_st')  # a line in the making
    return run


def test_goal_return_of_an_episode_by_hand(tmp_path: Path) -> None:
    curve = read_curve(write_run(tmp_path, 0, [0.5, 1.0]))
    # Coefficient 2, control step 0.02 s, 100 steps an episode: 4 at a term of 1.
    np.testing.assert_allclose(curve.columns["goal_return"], [2.0, 4.0])
    np.testing.assert_allclose(curve.columns["hours"], [0.01, 0.02])
    assert curve.goal_return_at(1) == pytest.approx(2.0)
    assert curve.goal_return_at(2) == pytest.approx(3.0)
    assert read_curve(None).iterations == 0


def test_curves_come_back_from_their_table_and_can_be_drawn(tmp_path: Path) -> None:
    curves = {
        ("one", 0): read_curve(write_run(tmp_path / "one", 0, [0.5, 1.0])),
        ("one", 3): read_curve(write_run(tmp_path / "one", 3, [0.25])),
        ("another", 0): read_curve(write_run(tmp_path / "another", 0, [0.75, 0.5, 0.25])),
    }
    save(curves, tmp_path / "curves.csv")
    again = load(tmp_path / "curves.csv")
    assert list(again) == list(curves)
    for key, curve in curves.items():
        for name, values in again[key].columns.items():
            np.testing.assert_allclose(values, curve.columns[name], rtol=1e-5)
    draw(again, tmp_path / "curves.png")
    assert (tmp_path / "curves.png").stat().st_size > 10_000


class Process:
    """In place of a training: notes the signals that it gets."""

    def __init__(self) -> None:
        self.signals: list[int] = []

    def send_signal(self, number: int) -> None:
        self.signals.append(number)


@pytest.fixture
def jobs(tmp_path: Path) -> list[Job]:
    """Two runs of four iterations; the second gets 70 % of the first's goal reward."""
    found = []
    for name, term in (("good", 1.0), ("poor", 0.7)):
        write_run(tmp_path / name, 0, [term] * 4)
        job = Job(Variant(name, "", ()), 0, tmp_path)
        job.process = Process()  # type: ignore[assignment]
        found.append(job)
    return found


def test_a_run_is_stopped_once_where_it_is_beaten_and_no_earlier(jobs: list[Job]) -> None:
    for job in jobs * 2:
        judge(job, jobs, until=10, check_at=[5])
    assert [job.stopped for job in jobs] == ["", ""]
    for job in jobs * 2:
        judge(job, jobs, until=10, check_at=[3])
    assert jobs[0].stopped == ""
    assert jobs[1].stopped == "beaten at iteration 3: goal return 2.80 against 4.00"
    assert [job.process.signals for job in jobs] == [[], [signal.SIGINT]]


def test_a_run_ends_where_it_is_to_end(jobs: list[Job]) -> None:
    judge(jobs[0], jobs, until=4, check_at=[])
    assert jobs[0].stopped == "reached iteration 4"


def test_the_run_of_a_seed_is_not_that_of_a_longer_number(tmp_path: Path) -> None:
    write_run(tmp_path, 11, [1.0])
    assert run_of(tmp_path, 1) is None
