"""Tables of numbers as text: commas, semicolons, tabs or spaces; comments; a line of names.

Where a semicolon or a tab divides the cells, a comma may be the decimal point.
"""

import re
from array import array

import numpy as np

from tlr_exp.motion.importers.raw import MotionFileError

TABLE = "the table"
COLUMNS = "the names of its columns"

_BOM = b"\xef\xbb\xbf"
_SEPARATORS = (";", "\t", ",")
_UTF16 = b"\xff\xfe", b"\xfe\xff"
# Every byte but control characters: a pickle begins with one, or has one soon.
_CONTROL = re.compile(rb"[\x00-\x08\x0e-\x1f\x7f]")
_SHOWN = 60


def is_text(data: bytes) -> bool:
    """Whether the first bytes are free of control characters."""
    return not _CONTROL.search(data[:65536])


def looks_like_text(data: bytes) -> bool:
    """Whether the first line is one of a table: cells divided by something, a number among them.

    A line of names counts, too, if numbers follow.
    """
    if data[:2] in _UTF16:
        return True
    if not is_text(data):
        return False
    start = data[:65536].removeprefix(_BOM)
    lines = [line for line in _lines(start.decode("latin-1")) if not line.startswith("#")]
    return any(len(cells) > 1 and any(map(_is_number, cells)) for cells in map(_guess, lines[:3]))


def parse_text(data: bytes) -> dict[str, object]:
    """The table of a file, and the names of its columns if it has them.

    Raises:
        MotionFileError: it is no table of numbers; the message names the line.
    """
    lines = _lines(_decoded(data))
    comments = [line.lstrip("# \t") for line in lines if line.startswith("#")]
    rows = [line for line in lines if not line.startswith("#")]
    if not rows:
        raise MotionFileError("it is a text without numbers")
    separator = _separator(rows[-1])
    names = None
    if not all(map(_is_number, _cells(rows[0], separator))):
        names = _cells(rows.pop(0), separator)
    if not rows:
        raise MotionFileError("it is a text without numbers")
    width = len(_cells(rows[0], separator))
    if names is None:
        # numpy writes the names as a comment.
        named = [cells for cells in (_cells(c, separator) for c in comments) if len(cells) == width]
        names = next((n for n in named if not any(map(_is_number, n))), None)
    content: dict[str, object] = {TABLE: _numbers(rows, separator)}
    if names is not None:
        if len(names) != width:
            raise MotionFileError(
                f"its first line names {len(names)} columns, the second has {width} numbers"
            )
        content[COLUMNS] = tuple(names)
    return content


def _decoded(data: bytes) -> str:
    if data[:2] in _UTF16:
        return data.decode("utf-16", "replace")
    # Names of other than ASCII are of no use to us, whatever their encoding.
    return data.removeprefix(_BOM).decode("utf-8", "replace")


def _lines(text: str) -> list[str]:
    return [stripped for line in text.splitlines() if (stripped := line.strip(" \r\n\x00"))]


def _guess(line: str) -> list[str]:
    return _cells(line, _separator(line))


def _separator(line: str) -> str | None:
    """What divides the cells of a line; None: white space."""
    return next((mark for mark in _SEPARATORS if mark in line), None)


def _cells(line: str, separator: str | None) -> list[str]:
    """The cells of a line, without quotation marks; one left empty at its end is no cell."""
    cells = [cell.strip().strip("\"'").strip() for cell in line.split(separator)]
    if len(cells) > 1 and not cells[-1]:
        cells.pop()
    if separator in (";", "\t"):
        cells = [cell.replace(",", ".") for cell in cells]
    return cells


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True


def _numbers(rows: list[str], separator: str | None) -> np.ndarray:
    """The cells of all rows, [rows, columns].

    Raises:
        MotionFileError: a cell is no number, or rows differ in length; the first such row is named.
    """
    width, table = len(_cells(rows[0], separator)), array("d")
    for number, row in enumerate(rows, start=1):
        cells = _cells(row, separator)
        if len(cells) != width:
            raise MotionFileError(
                f"it is no table of numbers: row {number} has {len(cells)} columns, the first has "
                f"{width}"
            )
        try:
            table.extend([float(cell) for cell in cells])
        except ValueError as error:
            wrong = next(cell for cell in cells if not _is_number(cell))
            raise MotionFileError(
                f"it is no table of numbers: row {number} has {wrong[:_SHOWN]!r} (behind comments "
                "and the line of names)"
            ) from error
    return np.array(table).reshape(len(rows), width)
