"""One run as it was found, wherever it was found: what a study is checked and made from."""

import json
import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import pandas as pd

from analysis.data.study import CURVE_KEYS, RUN, Study, StudyError, rows_of
from tlr_exp.config.versions import of_any_version
from tlr_exp.errors import UserError
from tlr_exp.keys import ITERATION

DIRTY = "-dirty"  # behind a commit: the source had local changes
# Columns of `Study.runs` that a record has as they are, as JSON, and by counting.
_PLAIN = (
    *("run_id", "method", "seed", "status", "scale", "motion", "device", "commit", "created_at"),
    *("identity", "host", "cpu_model", "command"),
)
_JSON = ("packages", "config")
_COUNTED = ("num_envs", "iterations", "control_steps")


@dataclass(frozen=True, eq=False)
class RunRecord:
    """A run before it is known whether it fits others.

    packages: version by name, with "tlr_exp" and "python". config: the resolved configuration.
    curve: one row per iteration in ascending order, the column "iteration" and a float64 column
    per metric. Texts that are not known are empty.
    """

    name: str
    run_id: str
    method: str
    seed: int
    status: str
    scale: str
    motion: str
    device: str
    commit: str
    created_at: str
    identity: str
    host: str
    cpu_model: str
    command: str
    packages: Mapping[str, str]
    config: Mapping[str, Any]
    curve: pd.DataFrame

    @cached_property
    def comparable(self) -> dict[str, Any]:
        """The configuration as this version writes it, whichever version the run is of."""
        return of_any_version(self.config)

    @property
    def num_envs(self) -> int:
        return int(self.config["scale"]["num_envs"])

    @property
    def iterations(self) -> int:
        """Configured iterations; those done are the rows of the curve."""
        return int(self.config["scale"]["iterations"])

    @property
    def control_steps(self) -> int:
        """Control steps taken so far, of all environments together."""
        return len(self.curve) * self.num_envs * int(self.config["ppo"]["num_steps"])


def run_record(
    manifest: Mapping[str, Any], config: Mapping[str, Any], curve: pd.DataFrame, where: str
) -> RunRecord:
    """A record from a run's manifest.json, its configuration and its curve; `where` for messages.

    Raises:
        StudyError: one line per entry that is missing or of a wrong kind.
    """
    problems = [*_manifest_problems(manifest), *_config_problems(config)]
    if problems:
        raise StudyError("\n".join(f"{where}: {problem}" for problem in problems))
    tags, machine = _part(manifest, "tags"), _part(manifest, "machine")
    git = _part(manifest, "git")
    versions = {"python": manifest.get("python"), "tlr_exp": manifest.get("tlr_exp")}
    packages = {**_part(manifest, "packages"), **versions}
    return RunRecord(
        name=str(manifest["name"]),
        run_id=str(manifest["run_id"]),
        method=str(tags["method"]),
        seed=int(manifest["seed"]),
        status=str(manifest["status"]),
        scale=str(tags.get("scale") or config["scale"].get("name") or ""),
        motion=str(tags.get("motion") or _part(config, "env").get("motion") or ""),
        device=str(tags.get("device") or config.get("device") or ""),
        commit=f"{git.get('commit') or ''}{DIRTY if git.get('dirty') else ''}",
        created_at=str(manifest.get("created_at") or ""),
        identity=str(manifest.get("identity") or ""),
        host=str(machine.get("host") or ""),
        cpu_model=str(machine.get("cpu_model") or ""),
        command=str(manifest.get("command") or ""),
        packages={name: str(text) for name, text in sorted(packages.items()) if text},
        config=config,
        curve=curve,
    )


def curve_from_rows(rows: Iterable[Mapping[str, Any]]) -> pd.DataFrame:
    """A curve from one mapping per iteration, None and absent values as NaN.

    Raises:
        ValueError: a value is no number, names metric and iteration.
    """
    rows = sorted(rows, key=lambda row: row[ITERATION])
    names = sorted({name for row in rows for name in row} - {ITERATION})
    columns = {name: np.full(len(rows), np.nan) for name in names}
    for index, row in enumerate(rows):
        for name, value in row.items():
            if name != ITERATION and value is not None:
                if not isinstance(value, int | float):
                    where = f"iteration {row[ITERATION]}"
                    raise UserError(f"{name} is {value!r} in {where}; it must be a number")
                columns[name][index] = value
    iterations = np.array([row[ITERATION] for row in rows], dtype=np.int64)
    return pd.DataFrame({ITERATION: iterations, **columns})


def study_from(records: Iterable[tuple[str, RunRecord]], **settings: Any) -> Study:
    """The study of (arm label, record) pairs, in this order; metrics in the order of their names.

    `settings` are the baseline and the notes of the study.

    Raises:
        StudyError: they are no usable study; names what is wrong.
    """
    runs, curves = [], []
    for arm, record in records:
        runs.append(_row(arm, record))
        keys = {RUN: record.name, "arm": arm, "seed": record.seed}
        length = len(record.curve)
        columns = {name: [value] * length for name, value in keys.items()}
        curves.append(pd.concat([pd.DataFrame(columns), record.curve], axis=1))
    if not runs:
        raise StudyError("there is no run")
    frame = pd.concat(curves, ignore_index=True)
    metrics = sorted(str(name) for name in frame.columns if name not in CURVE_KEYS)
    tidy = frame.reindex(columns=[*CURVE_KEYS, *metrics])
    return Study(pd.DataFrame(runs).set_index(RUN), tidy, **settings)


def records_of(study: Study) -> list[RunRecord]:
    """The runs of a study taken apart again, to be compared in another way.

    Raises:
        StudyError: packages or config are no JSON objects; one line for each.
    """
    problems = [
        f"{name}: its {column} is {text[:40]!r}; it must be a JSON object"
        for column in _JSON
        for name, text in zip(study.runs.index, study.runs[column].tolist(), strict=True)
        if not _is_json_object(text)
    ]
    if problems:
        raise StudyError("\n".join(problems))
    curves = dict(iter(study.curves.groupby(RUN, sort=False)))
    records = []
    for name, run in rows_of(study.runs).items():
        curve = curves[name].drop(columns=[RUN, "arm", "seed"]).sort_values(ITERATION)
        records.append(
            RunRecord(
                name=name,
                **{key: run[key] for key in _PLAIN},
                **{key: json.loads(run[key]) for key in _JSON},
                curve=curve.reset_index(drop=True),
            )
        )
    return records


def _is_json_object(text: str) -> bool:
    try:
        return isinstance(json.loads(text), dict)
    except ValueError:
        return False


def _row(arm: str, record: RunRecord) -> dict[str, Any]:
    values = {key: getattr(record, key) for key in (*_PLAIN, *_COUNTED)}
    texts = {key: json.dumps(getattr(record, key)) for key in _JSON}
    return {RUN: record.name, "arm": arm, **values, **texts}


def _manifest_problems(manifest: Mapping[str, Any]) -> Iterator[str]:
    for key in ("run_id", "name", "status"):
        if not manifest.get(key):
            yield f"manifest.json has no {key}"
    if not isinstance(manifest.get("seed"), int):
        yield f"manifest.json: seed is {manifest.get('seed')!r}; it must be an integer"
    if not _part(manifest, "tags").get("method"):
        yield "manifest.json has no tags.method, the name of the optimizer"


def _config_problems(config: Mapping[str, Any]) -> Iterator[str]:
    for group, key in (("scale", "num_envs"), ("scale", "iterations"), ("ppo", "num_steps")):
        value = _part(config, group).get(key)
        if not isinstance(value, int | float) or not math.isfinite(value) or value != int(value):
            yield f"config.yaml: {group}.{key} is {value!r}; it must be an integer"


def _part(data: Mapping[str, Any], key: str) -> Mapping[str, Any]:
    value = data.get(key) if isinstance(data, Mapping) else None
    return value if isinstance(value, Mapping) else {}
