"""The saved view of a new experiment: what MLflow's pages will read of it."""

import base64
import json
import zlib
from pathlib import Path

from stores import sql

from tlr_exp.keys import EPISODE_LENGTH, TRAIN_LOWER_BODY_ERROR, TRAIN_UPPER_BODY_ERROR
from tlr_exp.records.final_metrics import final_metrics
from tlr_exp.records.mlflow_store import experiment_id, open_client
from tlr_exp.records.mlflow_view import VIEW_QUERY, experiment_tags
from tlr_exp.records.sweep_page import progress


def test_view_has_the_columns_that_runs_and_sweeps_fill() -> None:
    (key,) = [name for name in experiment_tags(5) if "sharedViewState" in name]
    view = json.loads(experiment_tags(5)[key])
    assert (view["name"], view["createdAt"]) == ("Final numbers", 5)
    assert f"viewStateShareKey={key.removeprefix('mlflow.sharedViewState.')}&" in VIEW_QUERY
    method, _, packed = view["state"].partition(";")
    assert method == "deflate"
    state = json.loads(zlib.decompress(base64.b64decode(packed)))
    measured = (EPISODE_LENGTH, TRAIN_UPPER_BODY_ERROR, TRAIN_LOWER_BODY_ERROR, "eval/survival")
    row = {"iteration": 1, "wall_time": 1.0, **dict.fromkeys(measured, 1.0)}
    names = [*final_metrics([row]), *progress({"num_jobs": 1}, [])]
    shown = {column for column in state["selectedColumns"] if column.startswith("metrics.")}
    assert shown == {f"metrics.`{name}`" for name in names}
    assert set(state["columnOrder"]) - {"attributes.`Run Name`"} == set(state["selectedColumns"])


def test_only_a_new_experiment_gets_it(database: Path) -> None:
    uri = f"sqlite:///{database}"
    client = open_client(uri)
    old = client.create_experiment("old")
    assert experiment_id(client, "old", uri) == old
    new = experiment_id(client, "new", uri)
    query = "SELECT DISTINCT experiment_id FROM experiment_tags"
    assert sql(database, query) == [(int(new),)]
    assert "Final numbers" in client.get_experiment(new).tags["mlflow.note.content"]
