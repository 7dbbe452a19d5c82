"""Writes what MLflow shows of a sweep: name, tags, parameters, a description in Markdown.

Pure functions on the records of a sweep and of its jobs.
"""

import shlex
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from tlr_exp.mlflow_sync.names import (
    KIND_SWEEP,
    KIND_TAG,
    STATUS_TAG,
    SWEEP_TAG,
    plain_tags,
    program,
)
from tlr_exp.records.directory import FAILED, FINISHED
from tlr_exp.records.sweep_directory import JOB_STATUSES, JobRecord

SWEEP_ID_TAG = "tlr_exp.sweep_run_id"  # of a sweep's own run; "tlr_exp.run_id" is for runs
NOTE_TAG = "mlflow.note.content"
SWEPT_PREFIX = "swept."
JOBS_PREFIX = "jobs/"

_LABELS = ("method", "scale", "motion", "device")  # of the runs, as their manifests have them
_MAX_NOTE = 5000  # characters that MLflow keeps of a tag
_MAX_ERROR = 160


@dataclass(frozen=True)
class JobView:
    """A job as it stands: its record, its true status, its run's manifest and id in MLflow."""

    record: JobRecord
    status: str
    manifest: Mapping[str, Any] | None = None
    mlflow_run_id: str | None = None


def sweep_name(record: Mapping[str, Any], jobs: Sequence[JobView]) -> str:
    """NAME-SCALE-ID; without the scale while it is not known."""
    scale = _labels(record, jobs).get("scale", "").replace(", ", "+")
    return "-".join(part for part in (record["name"], scale, record["sweep_id"]) if part)


def sweep_parameters(record: Mapping[str, Any]) -> dict[str, str]:
    """What stays the same however often the sweep is continued."""
    names = ("name", "study", "sweep_id")
    return {f"sweep.{name}": str(record[name]) for name in names}


def sweep_tags(record: Mapping[str, Any], jobs: Sequence[JobView], status: str) -> dict[str, str]:
    """Tags to find the sweep by: labels of its runs, the values it goes through, its origin."""
    commits = {
        (job.manifest.get("git") or {}).get("commit", "")[:12] for job in jobs if job.manifest
    }
    return plain_tags(
        {
            SWEEP_ID_TAG: record["run_id"],
            STATUS_TAG: status,
            KIND_TAG: KIND_SWEEP,
            SWEEP_TAG: f"{record['name']}-{record['sweep_id']}",
            **{f"{SWEPT_PREFIX}{key}": text for key, text in swept_values(jobs).items()},
            "command": record.get("command"),
            "host": record.get("host"),
            "git_commit": ", ".join(sorted(commits - {""})) or None,
            "mlflow.source.name": program(record.get("command")),
            **_labels(record, jobs),
        }
    )


def swept_values(jobs: Sequence[JobView]) -> dict[str, str]:
    """Keys whose overrides differ between jobs, with their values in the order of jobs."""
    values: dict[str, dict[str, None]] = {}
    for job in jobs:
        for override in job.record.overrides:
            key, equals, value = _parts(override)
            if equals:
                values.setdefault(key, {})[value] = None
    return {key: ", ".join(found) for key, found in values.items() if len(found) > 1}


def _parts(override: str) -> tuple[str, str, str]:
    return override.lstrip("+").partition("=")


def progress(record: Mapping[str, Any], jobs: Sequence[JobView]) -> dict[str, float]:
    """Numbers of jobs as metrics: total, and those that ended either way."""
    return {
        f"{JOBS_PREFIX}total": float(record["num_jobs"]),
        f"{JOBS_PREFIX}finished": float(sum(job.status == FINISHED for job in jobs)),
        f"{JOBS_PREFIX}failed": float(sum(job.status == FAILED for job in jobs)),
    }


def sweep_note(
    record: Mapping[str, Any], jobs: Sequence[JobView], experiment_id: str, folder: str
) -> str:
    """The description in Markdown, at most 5000 characters: rows of the table are left out."""
    head = "\n".join(_head(record, jobs, folder))
    swept = swept_values(jobs)
    rows = [_row(job, swept, experiment_id) for job in jobs]
    shown = len(rows)
    while True:
        left_out = [f"\n… and {len(rows) - shown} more."] if shown < len(rows) else []
        table = ["", "| Job | What differs | Status | Run |", "|---|---|---|---|", *rows[:shown]]
        note = "\n".join([head, *(table if rows else []), *left_out])
        if len(note) <= _MAX_NOTE or shown == 0:
            return note[:_MAX_NOTE]
        shown -= 1


def _head(record: Mapping[str, Any], jobs: Sequence[JobView], folder: str) -> Iterator[str]:
    if record.get("description"):
        yield f"{record['description']}\n"
    counts = {status: sum(job.status == status for job in jobs) for status in JOB_STATUSES}
    counts["not begun"] = max(0, record["num_jobs"] - len(jobs))
    parts = [f"{count} {status}" for status, count in counts.items() if count]
    yield f"**{record['num_jobs']} jobs**: {', '.join(parts)}.\n"
    for key, values in swept_values(jobs).items():
        yield f"- `{key}`: {values}"
    yield "\nRepeat it (finished jobs are skipped, broken ones continue):\n"
    yield f"`{record.get('command', '')}`\n"
    yield f"It is in `{folder}`. To make its report and copy that here as an artifact:\n"
    yield f"    cd {shlex.quote(folder)}"
    yield "    tlr-export . -o results --force"
    yield "    tlr-report results -o report --force"
    yield "    tlr-sync .\n"
    yield "The runs are the children of this one in the list; a run that an earlier sweep has"
    yield f"already stays there. All of them: `tags.sweep LIKE '%{record['sweep_id']}%'`."


def _row(job: JobView, swept: Mapping[str, str], experiment_id: str) -> str:
    overrides = job.record.overrides
    differing = [text for text in overrides if _parts(text)[0] in swept] or overrides
    name = job.record.run or "-"
    if job.mlflow_run_id:
        page = f"#/experiments/{experiment_id}/runs/{job.mlflow_run_id}"
        name = f"[{name}]({page}?workflowType=machine_learning)"
    status = job.status
    if job.record.error:
        status += f": {_cell(job.record.error)}"
    return f"| {job.record.num} | `{' '.join(differing)}` | {status} | {name} |"


def _cell(text: str) -> str:
    """The first line of `text`, short, without what would end a cell of a table."""
    return text.strip().partition("\n")[0][:_MAX_ERROR].replace("|", "/")


def _labels(record: Mapping[str, Any], jobs: Sequence[JobView]) -> dict[str, str]:
    """Labels of all runs, several values joined; those that the sweep has itself go first."""
    labels = {}
    for label in _LABELS:
        tags = [(job.manifest.get("tags") or {}) for job in jobs if job.manifest]
        if values := list(dict.fromkeys(str(one[label]) for one in tags if label in one)):
            labels[label] = ", ".join(values)
    return labels | {name: str(text) for name, text in (record.get("tags") or {}).items()}
