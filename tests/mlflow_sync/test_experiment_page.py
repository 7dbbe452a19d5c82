"""The saved views of a new experiment: what MLflow's pages will read of them."""

import base64
import json
import re
import zlib
from pathlib import Path
from typing import Any

from stores import small_run, sql

from tlr_exp.keys import EPISODE_LENGTH, TRAIN_LOWER_BODY_ERROR, TRAIN_UPPER_BODY_ERROR
from tlr_exp.mlflow_sync.experiment_page import CURVES_QUERY, NUMBERS_QUERY, experiment_tags
from tlr_exp.mlflow_sync.store import experiment_id, open_client
from tlr_exp.mlflow_sync.sweep_page import progress
from tlr_exp.mlflow_sync.upload_run import RunUpload
from tlr_exp.records.final_metrics import final_metrics


def view_of(query: str) -> tuple[dict[str, Any], dict[str, Any]]:
    """The saved view that a link opens, and the state of the page that it holds."""
    (key,) = re.findall(r"viewStateShareKey=([\w-]+)&", query)
    view = json.loads(experiment_tags(5)[f"mlflow.sharedViewState.{key}"])
    method, _, packed = view["state"].partition(";")
    assert method == "deflate"
    return view, json.loads(zlib.decompress(base64.b64decode(packed)))


def test_numbers_have_the_columns_that_runs_and_sweeps_fill() -> None:
    view, state = view_of(NUMBERS_QUERY)
    assert (view["name"], view["createdAt"]) == ("Final numbers", 5)
    measured = (EPISODE_LENGTH, TRAIN_UPPER_BODY_ERROR, TRAIN_LOWER_BODY_ERROR, "eval/survival")
    row = {"iteration": 1, "wall_time": 1.0, **dict.fromkeys(measured, 1.0)}
    names = [*final_metrics([row]), *progress({"num_jobs": 1}, [])]
    shown = {column for column in state["selectedColumns"] if column.startswith("metrics.")}
    assert shown == {f"metrics.`{name}`" for name in names}
    assert set(state["columnOrder"]) - {"attributes.`Run Name`"} == set(state["selectedColumns"])
    assert (state["searchFilter"], state["groupBy"]) == ("", None)


def test_curves_are_those_of_runs_by_method(database: Path, tmp_path: Path) -> None:
    view, state = view_of(CURVES_QUERY)
    assert view["name"] == "Curves by method"
    assert state["groupBy"]["groupByKeys"] == [{"groupByData": "method", "mode": "tag"}]
    uri = f"sqlite:///{database}"
    run = RunUpload(small_run(tmp_path / "a", method="gwo"), uri, "study").push()
    client = open_client(uri)
    client.create_run(client.get_run(run.mlflow_run_id).info.experiment_id)  # of a sweep, say
    order = f"{state['orderByKey']} {'ASC' if state['orderByAsc'] else 'DESC'}"
    experiments = [found.experiment_id for found in client.search_experiments()]
    found = client.search_runs(experiments, state["searchFilter"], order_by=[order])
    assert [one.info.run_name for one in found] == ["a"]


def test_only_a_new_experiment_gets_it(database: Path) -> None:
    uri = f"sqlite:///{database}"
    client = open_client(uri)
    old = client.create_experiment("old")
    assert experiment_id(client, "old", uri) == old
    new = experiment_id(client, "new", uri)
    query = "SELECT DISTINCT experiment_id FROM experiment_tags"
    assert sql(database, query) == [(int(new),)]
    assert "Final numbers" in client.get_experiment(new).tags["mlflow.note.content"]
