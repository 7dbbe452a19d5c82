"""metrics.jsonl: one flat JSON object a line, one line an iteration, append-only.

A line is {"iteration": int, "wall_time": Unix seconds, NAME: number, ...}. JSON has no NaN and no
infinity, so every non-finite value is written as null and read back as NaN.
"""

import json
import math
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from tlr_exp.errors import UserError
from tlr_exp.keys import ITERATION
from tlr_exp.records.storage import append_line, atomic_write

WALL_TIME = "wall_time"


class DamagedMetricsError(UserError):
    """A line that others follow is not a metrics line; the message names file and place."""


def append_metrics(path: Path, iteration: int, metrics: Mapping[str, float]) -> None:
    """Append one line with the time of now.

    Raises:
        ValueError: a name is reserved, or a value is not a number (names it).
        StorageError: the disk is full, ...; the lines before stay.
    """
    line: dict[str, Any] = {ITERATION: int(iteration), WALL_TIME: round(time.time(), 3)}
    for name, value in metrics.items():
        if name in (ITERATION, WALL_TIME):
            raise UserError(f"metric name {name!r} is reserved for the line itself")
        line[name] = _plain_number(name, value)
    append_line(path, json.dumps(line, allow_nan=False).encode())


def read_metrics(path: Path, offset: int = 0) -> tuple[list[dict[str, Any]], int]:
    """The whole lines from byte `offset` on, and the offset behind them.

    An unfinished or torn last line is left for the next call. A file that is not there is empty.

    Raises:
        DamagedMetricsError: a line that others follow is not a metrics line.
    """
    try:
        with open(path, "rb") as file:
            file.seek(offset)
            data = file.read()
    except FileNotFoundError:
        return [], offset
    *lines, _unfinished = data.split(b"\n")
    rows: list[dict[str, Any]] = []
    for number, line in enumerate(lines, start=1):
        row = _parse(line)
        if row is None and number == len(lines):
            break
        if row is None:
            raise DamagedMetricsError(
                f"{path}: the line at byte {offset} is damaged: {line[:60]!r}"
            )
        rows.append(row)
        offset += len(line) + 1
    return rows, offset


def last_of_each_iteration(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """`rows` in the order of iterations; of an iteration logged twice, the later row."""
    return [row for _, row in sorted({row[ITERATION]: row for row in rows}.items())]


def rewrite_until(path: Path, iteration: int) -> None:
    """Drop the lines past `iteration` (all of them for -1), atomically.

    Raises:
        StorageError: the file cannot be rewritten; the old one stays.
    """
    if not path.exists():
        return
    rows = last_of_each_iteration(read_metrics(path)[0])
    kept = (json.dumps(_with_null(row)) for row in rows if row[ITERATION] <= iteration)
    atomic_write(path, "".join(line + "\n" for line in kept).encode())


def _plain_number(name: str, value: Any) -> float | int | None:
    """`value` (a number of Python, NumPy or a one-element tensor) as JSON can hold it."""
    if isinstance(value, int):
        return int(value)  # bool becomes 0 or 1
    try:
        number = float(value)
    except (TypeError, ValueError, RuntimeError) as error:
        raise UserError(f"metric {name!r} is {type(value).__name__}, not one number") from error
    return number if math.isfinite(number) else None


def _with_null(row: dict[str, Any]) -> dict[str, Any]:
    return {name: None if value != value else value for name, value in row.items()}


def _parse(line: bytes) -> dict[str, Any] | None:
    try:
        row = json.loads(line)
    except ValueError:
        return None
    if not isinstance(row, dict) or not isinstance(row.get(ITERATION), int):
        return None
    return {name: math.nan if value is None else value for name, value in row.items()}
