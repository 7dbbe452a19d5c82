"""Policies as rows of a strip: what they are called there."""

from collections.abc import Sequence
from pathlib import Path

from tlr_exp.evaluation.choosing import Choice
from tlr_exp.evaluation.policies import Evaluation
from tlr_exp.keys import METHOD_NAMES
from tlr_exp.pictures.strips import StripRow
from tlr_exp.records.run_directory import RunDirectory


def method_of(run: Path) -> str:
    """What a run's method is called in pictures: static, two-layered (GWO), ..."""
    method = RunDirectory.open(run).manifest["tags"].get("method") or run.name
    return METHOD_NAMES.get(method, method)


def row_of(evaluation: Evaluation, among: Sequence[Choice]) -> StripRow:
    """A policy's row. Its label tells what it needs to among the others: seed, run, iteration."""
    choice = evaluation.choice
    label = method_of(choice.run)
    rivals = [c for c in among if c is not choice and method_of(c.run) == label]
    if rivals:
        label += f"\nseed {choice.settings.seed}"
        if any(c.settings.seed == choice.settings.seed for c in rivals):
            label += f"\n{choice.run.name}"
    if len({c.iteration for c in among}) > 1:
        label += f"\niteration {choice.iteration}"
    limit = choice.settings.env.termination.max_tilt
    return StripRow(label, evaluation.trajectory, evaluation.result, limit)
