"""Runs to check, and ways to spoil them."""

import copy
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from studies import make_study

from analysis.data.check import checked
from analysis.data.runs import RunRecord, records_of
from analysis.data.study import StudyError

FIXED = "demo-fixed-seed"
GWO = "demo-gwo-seed"


def records(arms: Sequence[str] = ("fixed", "gwo"), seeds: int = 3) -> list[RunRecord]:
    study = make_study(np.random.default_rng(0), arms, range(seeds), iterations=4)
    return records_of(study)


def index(runs: Sequence[RunRecord], start: str) -> int:
    (found,) = [number for number, run in enumerate(runs) if run.name.startswith(start)]
    return found


def changed(runs: Sequence[RunRecord], start: str, **changes: Any) -> list[RunRecord]:
    """`runs` with one of them, by the start of its name, changed."""
    number = index(runs, start)
    return [*runs[:number], replace(runs[number], **changes), *runs[number + 1 :]]


def with_setting(run: RunRecord, key: str, value: Any) -> RunRecord:
    config = copy.deepcopy(dict(run.config))
    *parents, last = key.split(".")
    group = config
    for parent in parents:
        group = group.setdefault(parent, {})
    group[last] = value
    return replace(run, config=config)


def set_in(runs: Sequence[RunRecord], start: str, key: str, value: Any) -> list[RunRecord]:
    number = index(runs, start)
    return [*runs[:number], with_setting(runs[number], key, value), *runs[number + 1 :]]


def lines_of(runs: Sequence[RunRecord], *arguments: Any, **choices: Any) -> list[str]:
    with pytest.raises(StudyError) as caught:
        checked(runs, *arguments, **choices)
    return str(caught.value).splitlines()
