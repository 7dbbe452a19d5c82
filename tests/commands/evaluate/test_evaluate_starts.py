"""tlr-evaluate --starts: where the roll-outs begin, and what is said of them together."""

import dataclasses
import json
import math

import pytest
from rich.console import Console
from trajectories import still_trajectory

from tlr_exp.commands import evaluate
from tlr_exp.evaluation.result import EvaluationResult, evaluate_trajectory
from tlr_exp.evaluation.starts import Start, starts_table, summary
from tlr_exp.reward.split import RewardSplit


def result(survival: float, latency_ms: float | None) -> EvaluationResult:
    split = RewardSplit({"body_pos": 1.0}, {}, 0.02, ["body_pos"])
    made = evaluate_trajectory(still_trajectory(), 0.8, 0.3, split)
    return dataclasses.replace(made, survival=survival, latency_ms=latency_ms)


def test_mean_and_spread_by_hand():
    each = [Start(0, 0.0, result(1.0, None)), Start(10, 0.25, result(0.5, -30.0))]
    summed = summary(each)
    # Sample standard deviation of 1 and 0.5: sqrt(2 * 0.25^2 / (2 - 1)).
    expected = {"mean": 0.75, "std": math.sqrt(0.125), "min": 0.5, "max": 1.0}
    assert summed["survival"] == pytest.approx(expected)
    assert summed["latency_ms"] == {"mean": -30.0, "std": 0.0, "min": -30.0, "max": -30.0}
    assert summary(each[:1])["latency_ms"] is None
    survival = next(c for c in starts_table(each, "").columns if "vival" in str(c.header))
    assert list(survival.cells) == ["100.0", "50.0", "75.0", "35.4", "50.0", "100.0"]
    with (console := Console(width=80)).capture() as shown:
        console.print(starts_table(each, ""))
    assert "…" not in shown.get()


def test_the_first_roll_out_is_the_one_without_starts(untrained_run, tmp_path, capsys):
    command = [str(untrained_run), "--no-video", "--no-pictures", "-o", str(tmp_path)]
    assert evaluate.main(command) == 0
    assert "start phases" not in capsys.readouterr().out
    assert evaluate.main([*command, "--starts", "3"]) == 0
    assert "from 3 start phases" in capsys.readouterr().out
    alone = json.loads((tmp_path / "000005-native.json").read_text())
    record = json.loads((tmp_path / "000005-native-3starts.json").read_text())
    starts = record.pop("starts")
    # The network's matrix products may round otherwise in a batch.
    terms = record.pop("terms")
    assert terms == pytest.approx(alone.pop("terms"), rel=1e-4, abs=1e-7)
    assert record == {
        key: pytest.approx(value, rel=1e-4) if isinstance(value, float) else value
        for key, value in alone.items()
    }
    assert starts["count"] == 3
    first, *others = starts["each"]
    assert (first.pop("start_frame"), first.pop("start_phase")) == (0, 0.0)
    assert first == {**{key: record[key] for key in first if key in record}, "terms": terms}
    # 39 steps, of the 41 frames one being the start and one the lead.
    assert [start["start_frame"] for start in others] == [13, 26]
    assert [start["num_steps"] for start in others] == [26, 13]
    assert others[0]["start_phase"] == pytest.approx(13 / 40)
    errors = [start["upper_body_error_m"] for start in starts["each"]]
    assert len(set(errors)) == 3
    assert starts["summary"]["upper_body_error_m"]["mean"] == pytest.approx(sum(errors) / 3)
