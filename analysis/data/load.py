"""The runs of a study out of an MLflow store. Importing it imports MLflow, which takes seconds."""

import json
import math
import sqlite3
import tempfile
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from pathlib import Path
from typing import Any
from urllib.parse import quote

import numpy as np
import pandas as pd

from analysis.data.runs import RunRecord, run_record
from analysis.data.study import StudyError
from tlr_exp.config.nested import with_value
from tlr_exp.keys import FINAL_PREFIX, ITERATION
from tlr_exp.mlflow_sync.names import (
    EXTENDED_TAG,
    KIND_SWEEP,
    KIND_TAG,
    RUN_ID_TAG,
    STATUS_TAG,
    SWEEP_TAG,
    VERSION_PREFIX,
)
from tlr_exp.mlflow_sync.store import MlflowException, TrackingError, open_client, tracking_errors
from tlr_exp.mlflow_sync.tracking_uri import sqlite_path
from tlr_exp.records.credentials import hide_password
from tlr_exp.records.directory import MANIFEST, RecordError
from tlr_exp.records.extending import ITERATIONS
from tlr_exp.records.run_directory import CONFIG, RunDirectory

_PAGE = 1000  # runs a search, MLflow's limit
_AT_ONCE = 500  # runs a query; SQLite takes at most 999 variables in some builds
_REQUESTS = 8  # to a server at a time
_POINTS = ["run", "key", "step", "timestamp", "value"]


def from_mlflow(tracking_uri: str, experiment: str, sweep: str | None = None) -> list[RunRecord]:
    """The training runs of an MLflow experiment, by name; parents of sweeps are passed over.

    `sweep` (NAME-ID, as its directory is called) takes only the runs that belong to that sweep.
    Manifest and configuration are the run's artifacts; where these cannot be reached, they are put
    together from its tags and parameters. Of a step that was logged twice, the later point counts;
    an iteration counts once all of its metrics are there.

    Raises:
        StudyError: the store or the experiment is not there, or a run cannot be read.
    """
    try:
        with tracking_errors(tracking_uri):
            client = _open(tracking_uri)
            runs = _training_runs(client, tracking_uri, experiment, sweep)
            points = _points(client, tracking_uri, runs)
            parts = [_manifest_and_config(client, run) for run in runs]
    except TrackingError as error:
        raise StudyError(str(error)) from error
    nothing = points.iloc[:0]
    curves = dict(iter(points.groupby("run", sort=False)))
    records, problems = [], []
    for run, (manifest, config) in zip(runs, parts, strict=True):
        run_points: Any = curves.get(run.info.run_id, nothing)
        try:
            name = str(run.info.run_name)
            records.append(run_record(manifest, config, _curve(run_points), name))
        except StudyError as error:
            problems.append(str(error))
    if problems:
        raise StudyError("\n".join(problems))
    return sorted(records, key=lambda record: (record.name, record.run_id))


def _open(uri: str) -> Any:
    """A client of the store at `uri`, which is not made where there is none."""
    database = sqlite_path(uri)
    if database is not None and not (database.is_file() and database.stat().st_size > 0):
        raise StudyError(f"there is no MLflow store {database}")
    return open_client(uri)


def _training_runs(client: Any, uri: str, experiment: str, sweep: str | None) -> list[Any]:
    found = client.get_experiment_by_name(experiment)
    if found is None or found.lifecycle_stage != "active":
        names = ", ".join(sorted(each.name for each in client.search_experiments()))
        place = hide_password(uri)
        raise StudyError(f"{place} has no experiment {experiment!r}; it has: {names}")
    runs = [run for run in _all_runs(client, found.experiment_id) if _is_training(run)]
    runs = [run for run in runs if sweep is None or sweep in _sweeps(run)]
    if not runs:
        what = f" of the sweep {sweep}" if sweep else ""
        raise StudyError(f"the MLflow experiment {experiment!r} has no training run{what}")
    return runs


def _all_runs(client: Any, experiment_id: str) -> list[Any]:
    runs, token = [], None
    while True:
        page = client.search_runs([experiment_id], max_results=_PAGE, page_token=token)
        runs += page
        token = page.token
        if not token:
            return runs


def _is_training(run: Any) -> bool:
    tags = run.data.tags
    return RUN_ID_TAG in tags and tags.get(KIND_TAG) != KIND_SWEEP


def _sweeps(run: Any) -> list[str]:
    return run.data.tags.get(SWEEP_TAG, "").split(", ")


# --- curves ----------------------------------------------------------------------------------
def _points(client: Any, uri: str, runs: Sequence[Any]) -> pd.DataFrame:
    """Every point of every run: run (MLflow's id), key, step, timestamp (ms), value.

    From a sqlite file by SQL, which is several times faster than asking for one metric of one run
    after another, the way that every store knows.
    """
    database = sqlite_path(uri)
    if database is not None:
        points = _points_by_sql(database, [run.info.run_id for run in runs])
        if points is not None:
            return points
    return _points_by_client(client, runs)


def _points_by_client(client: Any, runs: Sequence[Any]) -> pd.DataFrame:
    wanted = [
        (run.info.run_id, key)
        for run in runs
        for key in run.data.metrics
        if not key.startswith(FINAL_PREFIX)
    ]
    with ThreadPoolExecutor(_REQUESTS) as pool:  # a server is waited for most of the time
        histories = pool.map(lambda each: client.get_metric_history(*each), wanted)
        rows = [
            (run_id, key, point.step, point.timestamp, point.value)
            for (run_id, key), history in zip(wanted, histories, strict=True)
            for point in history
        ]
    return pd.DataFrame(rows, columns=_POINTS)


def _points_by_sql(database: Path, run_ids: Sequence[str]) -> pd.DataFrame | None:
    """The same from the table of MLflow 3; None where another version laid it out differently."""
    address = f"file:{quote(str(database.absolute()))}?mode=ro"
    frames = []
    with closing(sqlite3.connect(address, uri=True, timeout=20)) as connection:
        columns = {row[1] for row in connection.execute("PRAGMA table_info(metrics)")}
        if not {"run_uuid", "key", "step", "timestamp", "value", "is_nan"} <= columns:
            return None
        for start in range(0, len(run_ids), _AT_ONCE):
            ids = run_ids[start : start + _AT_ONCE]
            query = (
                "SELECT run_uuid, key, step, timestamp, CASE WHEN is_nan THEN NULL ELSE value END "
                f"FROM metrics WHERE run_uuid IN ({','.join('?' * len(ids))}) AND key NOT LIKE ?"
            )
            rows = connection.execute(query, [*ids, f"{FINAL_PREFIX}%"]).fetchall()
            frames.append(pd.DataFrame(rows, columns=_POINTS))
    points = pd.concat(frames, ignore_index=True)
    return points.astype({"value": np.float64})


def _curve(points: pd.DataFrame) -> pd.DataFrame:
    """One row per iteration, a column per metric by name.

    Training logs the metric "iteration" last, so a step without it is not whole.
    """
    last = points.sort_values("timestamp", kind="stable")
    last = last.drop_duplicates(["key", "step"], keep="last")
    table = last.pivot(index="step", columns="key", values="value").sort_index()
    if ITERATION not in table.columns:
        return pd.DataFrame({ITERATION: np.array([], dtype=np.int64)})
    whole = table.dropna(subset=[ITERATION])
    table = whole.drop(columns=ITERATION).astype(np.float64)
    table.insert(0, ITERATION, table.index.to_numpy(dtype=np.int64))
    table.columns.name = None
    return table.reset_index(drop=True)


# --- manifest and configuration --------------------------------------------------------------
def _manifest_and_config(client: Any, run: Any) -> tuple[dict[str, Any], dict[str, Any]]:
    with tempfile.TemporaryDirectory() as folder:
        try:
            for name in (MANIFEST, CONFIG):
                client.download_artifacts(run.info.run_id, name, folder)
            manifest, config = RunDirectory(folder).manifest, RunDirectory(folder).config
        except (OSError, RecordError, MlflowException):
            config = _config_from_parameters(run.data.params)
            if extended := run.data.tags.get(EXTENDED_TAG):  # parameters keep their first values
                config = with_value(config, ITERATIONS, _value(extended))
            return _manifest_from_tags(run), config
    # A killed run's own manifest says running for ever.
    return {**manifest, "status": run.data.tags.get(STATUS_TAG, manifest["status"])}, config


def _manifest_from_tags(run: Any) -> dict[str, Any]:
    """What tlr_exp.mlflow_sync.names.run_tags put there, as far as the analysis needs it."""
    tags: Mapping[str, str] = run.data.tags
    versions = {
        name.removeprefix(VERSION_PREFIX): text
        for name, text in tags.items()
        if name.startswith(VERSION_PREFIX)
    }
    created = pd.Timestamp(run.info.start_time, unit="ms", tz="UTC").isoformat()
    return {
        "run_id": tags[RUN_ID_TAG],
        "name": run.info.run_name,
        "identity": tags.get("identity"),
        "status": tags.get(STATUS_TAG, str(run.info.status).lower()),
        "created_at": created,
        "command": tags.get("command"),
        "seed": _value(tags.get("seed", "null")),
        "tags": {key: tags.get(key) for key in ("method", "scale", "device", "motion")},
        "git": {"commit": tags.get("git_commit"), "dirty": tags.get("git_dirty") == "true"},
        "tlr_exp": versions.pop("tlr_exp", None),
        "python": versions.pop("python", None),
        "packages": versions,
        "machine": {key: tags.get(key) for key in ("host", "cpu_model")},
    }


def _config_from_parameters(parameters: Mapping[str, str]) -> dict[str, Any]:
    config: dict[str, Any] = {}
    for key, text in parameters.items():
        config = with_value(config, key, _value(text))
    return config


def _value(text: str) -> Any:
    """What a parameter's text stood for: texts are kept as they are, all else is JSON."""
    try:
        value = json.loads(text)
    except ValueError:
        return text
    return text if isinstance(value, float) and not math.isfinite(value) else value
