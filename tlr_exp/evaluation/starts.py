"""A policy from several start phases: one roll-out alone can be luck, several tell how robust."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from statistics import fmean, stdev
from typing import Any

from rich.table import Table

from tlr_exp.assembly.split import build_judged_split
from tlr_exp.evaluation.choosing import Choice
from tlr_exp.evaluation.conditions import UNDISTURBED, Condition
from tlr_exp.evaluation.measures import MEASURES, SHOWN
from tlr_exp.evaluation.policies import Evaluation, prepare
from tlr_exp.evaluation.records import origin_of
from tlr_exp.evaluation.result import EvaluationResult, evaluate_policy


@dataclass(frozen=True)
class Start:
    """A roll-out from ``frame`` to the end of the motion; ``phase`` is the share of the motion."""

    frame: int
    phase: float
    result: EvaluationResult

    def to_dict(self) -> dict[str, Any]:
        """Plain values, ready for JSON."""
        return {"start_frame": self.frame, "start_phase": self.phase, **self.result.to_dict()}


def evaluate_starts(
    choice: Choice, starts: int, condition: Condition = UNDISTURBED
) -> tuple[Evaluation, list[Start]]:
    """Roll a policy out from evenly spaced phases; the evaluation is that from phase 0.

    Raises:
        ValueError: as ``evaluate``; the motion has fewer steps than that.
    """
    env, policy = prepare(choice, starts, condition)
    last = env.reference.num_frames - 1
    measured = evaluate_policy(env, policy, build_judged_split(choice.settings, env.term_names))
    frames = env.start_frame.tolist()
    each = [
        Start(frame, frame / last, result)
        for frame, (_, result) in zip(frames, measured, strict=True)
    ]
    return Evaluation(choice, *measured[0]), each


def summary(each: Sequence[Start]) -> dict[str, dict[str, float] | None]:
    """Mean, sample standard deviation, minimum and maximum of every measure, by name.

    None where no roll-out has the measure; the deviation of a single value is 0.
    """
    summed: dict[str, dict[str, float] | None] = {}
    for name in MEASURES:
        values = [getattr(start.result, name) for start in each]
        known = [value for value in values if value is not None]
        summed[name] = _spread(known) if known else None
    return summed


def _spread(values: Sequence[float]) -> dict[str, float]:
    return {
        "mean": fmean(values),
        "std": stdev(values) if len(values) > 1 else 0.0,
        "min": min(values),
        "max": max(values),
    }


def record_of(evaluation: Evaluation, each: Sequence[Start]) -> dict[str, Any]:
    """The evaluation from phase 0 as a record; of several starts with all of them."""
    record = {**origin_of(evaluation.choice), **evaluation.result.to_dict()}
    return {**record, "starts": starts_record(each)} if len(each) > 1 else record


def starts_record(each: Sequence[Start]) -> dict[str, Any]:
    """All starts and their summary, ready for JSON."""
    return {
        "count": len(each),
        "summary": summary(each),
        "each": [start.to_dict() for start in each],
    }


def starts_table(each: Sequence[Start], title: str) -> Table:
    """A row for each start, and their mean and standard deviation below."""
    table = Table(title=title, title_justify="left")
    for heading in ("start\nphase", "of\ns", *(measure.heading for measure in SHOWN.values())):
        table.add_column(heading, justify="right")
    for start in each:
        values = {name: getattr(start.result, name) for name in SHOWN}
        table.add_row(f"{start.phase:.2f}", f"{start.result.duration_s:.2f}", *_cells(values))
    table.add_section()
    summed = summary(each)
    for kind in ("mean", "std", "min", "max"):
        values = {name: spread[kind] if spread else None for name, spread in summed.items()}
        table.add_row(kind, "", *_cells(values))
    return table


def _cells(values: dict[str, float | None]) -> list[str]:
    return [measure.text(values[name]) for name, measure in SHOWN.items()]
