"""What an evaluation leaves behind as numbers: the JSON of a checkpoint, beside its run."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from tlr_exp.errors import UserError
from tlr_exp.evaluation.choosing import Choice
from tlr_exp.records.outputs import check_free
from tlr_exp.records.run_directory import EVALUATIONS
from tlr_exp.records.storage import atomic_write, json_bytes


def evaluation_folder(choice: Choice) -> Path:
    """Where an evaluation of the run goes unless told otherwise."""
    return choice.run / EVALUATIONS


def evaluation_name(choice: Choice, starts: int, disturbance: str = "") -> str:
    """Name of an evaluation's files, without their endings: 000350-native-4starts-push-0.5."""
    name = f"{choice.iteration:06d}-{choice.physics}"
    name = f"{name}-{starts}starts" if starts > 1 else name
    return f"{name}-{disturbance}" if disturbance else name


def origin_of(choice: Choice) -> dict[str, Any]:
    """What the numbers are of."""
    return {
        "run": str(choice.run),
        "checkpoint": choice.checkpoint.name,
        "iteration": choice.iteration,
        "physics": choice.physics,
        "motion": choice.motion,
        "seed": choice.settings.seed,
    }


def content_of(record: dict[str, Any]) -> bytes:
    """A record as it is written."""
    return json_bytes(record, allow_nan=False)


def write_whole(path: Path, content: bytes, force: bool) -> str:
    """Write a file and say so; one that holds the same already is left as it is.

    Raises:
        FileExistsError: the file holds something else, and ``force`` is not given.
    """
    if path.exists() and path.read_bytes() == content:
        return f"{path} holds the same already"
    check_free([path], force)
    atomic_write(path, content)
    return f"wrote {path}"


def read_starts(path: Path, starts: int) -> list[dict[str, Any]]:
    """The ``starts`` roll-outs that a record holds, as ``Start.to_dict`` gives them.

    Raises:
        ValueError: it is no record of so many roll-outs.
    """
    try:
        record = json.loads(path.read_text(encoding="utf-8"))
        each = record["starts"]["each"] if starts > 1 else [record]
        first = {"start_frame": 0, "start_phase": 0.0}
        rows = [{**first, **row, "terms": {**row["terms"]}} for row in each]
        complete = len(rows) == starts and all("survival" in row for row in rows)
    except (ValueError, KeyError, TypeError):
        complete, rows = False, []
    if not complete:
        raise UserError(
            f"{path} is no whole record of {starts} roll-outs: move it away, or measure the run "
            f"alone with tlr-evaluate RUN --starts {starts} --force"
        )
    return rows
