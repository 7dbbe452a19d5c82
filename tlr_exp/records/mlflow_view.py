"""How MLflow's pages show a new experiment: with a description and a saved view of final numbers.

The format of a saved view is that of MLflow 3.17's own pages (button "Views"): a tag of the
experiment with a name and the compressed state of the page. Pages that do not know it show no view.
"""

from __future__ import annotations

import base64
import json
import zlib
from urllib.parse import quote

from tlr_exp.keys import FINAL_PREFIX
from tlr_exp.records.mlflow_names import KIND_RUN, KIND_TAG
from tlr_exp.records.sweep_page import JOBS_PREFIX, NOTE_TAG

VIEW_KEY = "final-numbers"
# What follows .../#/experiments/ID/runs to open the view, or the charts of all runs, at once.
VIEW_QUERY = f"?viewStateShareKey={VIEW_KEY}&workflowType=machine_learning"
CHARTS_QUERY = "?workflowType=machine_learning&compareRunsMode=CHART&searchFilter=" + quote(
    f"tags.{KIND_TAG} = '{KIND_RUN}'", safe=""
)

_NOTE = (
    "Runs and sweeps of a study of tlr_exp. For a list that can be read, choose **Model training** "
    "and **Runs** on the left, then **Views** and *Final numbers* on the right."
)
_NAME = "attributes.`Run Name`"
_TAGS = ("method", "seed")
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
    **{f"tags.`{name}`": 85 for name in _TAGS},
    **{f"metrics.`{name}`": 10 + 7 * len(name) for name in _METRICS},
}


def experiment_tags(now_ms: int) -> dict[str, str]:
    """The tags of a new experiment; `now_ms` is the Unix time in milliseconds."""
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
    }
    packed = base64.b64encode(zlib.compress(json.dumps(state).encode())).decode()
    view = {
        "name": "Final numbers",
        "createdAt": now_ms,
        "updatedAt": now_ms,
        "state": f"deflate;{packed}",
    }
    return {NOTE_TAG: _NOTE, f"mlflow.sharedViewState.{VIEW_KEY}": json.dumps(view)}
