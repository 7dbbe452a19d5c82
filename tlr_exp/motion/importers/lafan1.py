"""Unitree's retargeted LAFAN1 ``.csv``: 36 columns without a header, root quaternions xyzw."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from tlr_exp.motion.importers.raw import (
    JOINT_NAMES_29,
    MotionFileError,
    Options,
    RawMotion,
    assemble,
    take,
    take_rate,
    wxyz,
)

TABLE = "the table"
FPS = 30.0
_COLUMNS = 7 + len(JOINT_NAMES_29)


def looks_like(data: bytes) -> bool:
    """Whether the first line holds numbers between commas."""
    first = data[:4096].lstrip(b"\xef\xbb\xbf").split(b"\n", 1)[0]
    cells = first.split(b",")
    if len(cells) < 2:
        return False
    try:
        [float(cell) for cell in cells[:3]]
    except ValueError:
        return False
    return True


def parse(data: bytes) -> dict[str, np.ndarray]:
    """The table of a file.

    Raises:
        MotionFileError: it is no table of numbers.
    """
    try:
        lines = data.decode("utf-8-sig").splitlines()
        return {TABLE: np.loadtxt(lines, delimiter=",", comments=None, ndmin=2)}
    except ValueError as error:
        raise MotionFileError(f"it is no table of numbers: {error}") from error


def read(content: Mapping[str, Any], options: Options) -> list[RawMotion]:
    """The motion at 30 frames a second, or at ``options.fps``: the file does not say.

    Raises:
        MotionFileError: see ``raw``.
    """
    table = take(content, TABLE, _COLUMNS)
    qpos = assemble(table[:, :3], wxyz(table[:, 3:7]), table[:, 7:], JOINT_NAMES_29)
    return [RawMotion(take_rate({"fps": FPS}, "fps", options), qpos)]
