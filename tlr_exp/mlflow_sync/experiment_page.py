"""Has MLflow's pages show a new experiment with a description and two saved views.

The format of a saved view is that of MLflow 3.17's own pages (button "Views"): a tag of the
experiment with a name and the compressed state of the page. Pages that do not know it show no view.
"""

import base64
import json
import zlib
from typing import Any

from tlr_exp.keys import FINAL_PREFIX
from tlr_exp.mlflow_sync.names import KIND_RUN, KIND_TAG
from tlr_exp.mlflow_sync.sweep_page import JOBS_PREFIX, NOTE_TAG

NUMBERS_KEY, CURVES_KEY = "final-numbers", "curves-by-method"
# What follows .../#/experiments/ID/runs to open one of the views at once.
NUMBERS_QUERY = f"?viewStateShareKey={NUMBERS_KEY}&workflowType=machine_learning"
CURVES_QUERY = (
    f"?viewStateShareKey={CURVES_KEY}&workflowType=machine_learning&compareRunsMode=CHART"
)

_NOTE = (
    "Runs and sweeps of a study of tlr_exp. For a list that can be read, choose **Model training** "
    "and **Runs** on the left, then **Views** and *Final numbers* on the right."
)
_VIEW_TAG = "mlflow.sharedViewState."
_NAME = "attributes.`Run Name`"
_METHOD, _SEED = "method", "seed"
_METRICS = (
    f"{FINAL_PREFIX}episode_length",
    f"{FINAL_PREFIX}upper_body_error_m",
    f"{FINAL_PREFIX}lower_body_error_m",
    f"{FINAL_PREFIX}eval_survival",
    f"{JOBS_PREFIX}finished",
    f"{JOBS_PREFIX}failed",
    f"{JOBS_PREFIX}total",
)
_COLUMNS = {  # and their widths in pixels
    "attributes.`Duration`": 80,
    f"tags.`{_METHOD}`": 85,
    f"tags.`{_SEED}`": 85,
    **{f"metrics.`{name}`": 10 + 7 * len(name) for name in _METRICS},
}


def experiment_tags(now_ms: int) -> dict[str, str]:
    """The tags of a new experiment; `now_ms` is the Unix time in milliseconds."""
    by_method = {
        "aggregateFunction": "average",
        "groupByKeys": [{"groupByData": _METHOD, "mode": "tag"}],
    }
    curves = {
        "searchFilter": f"tags.{KIND_TAG} = '{KIND_RUN}'",
        # In the order of anything but time the list is flat, so that sweeps stay out of it.
        "orderByKey": f"tags.`{_METHOD}`",
        "orderByAsc": True,
        "groupBy": by_method,
    }
    return {
        NOTE_TAG: _NOTE,
        f"{_VIEW_TAG}{NUMBERS_KEY}": _saved_view("Final numbers", {}, now_ms),
        f"{_VIEW_TAG}{CURVES_KEY}": _saved_view("Curves by method", curves, now_ms),
    }


def _saved_view(name: str, changes: dict[str, Any], now_ms: int) -> str:
    """The value of the tag of a view: the list of runs with our columns, but for `changes`."""
    state = {
        "searchFilter": "",
        "orderByKey": "attributes.start_time",
        "orderByAsc": False,
        "startTime": "ALL",
        "lifecycleFilter": "Active",
        "datasetsFilter": [],
        "modelVersionFilter": "All Runs",
        "selectedColumns": list(_COLUMNS),
        "columnOrder": [_NAME, *_COLUMNS],
        "columnWidths": {_NAME: 250, **_COLUMNS},
        "runsHiddenMode": "FIRST_20_RUNS",
        "viewMaximized": False,
        "runListHidden": False,
        "useGroupedValuesInCharts": True,
        "hideEmptyCharts": True,
        "groupBy": None,
        "groupsExpanded": {},
        "globalLineChartConfig": {
            "xAxisKey": "step",
            "lineSmoothness": 0,
            "selectedXAxisMetricKey": "",
        },
        **changes,
    }
    packed = base64.b64encode(zlib.compress(json.dumps(state).encode())).decode()
    view = {"name": name, "createdAt": now_ms, "updatedAt": now_ms, "state": f"deflate;{packed}"}
    return json.dumps(view)
