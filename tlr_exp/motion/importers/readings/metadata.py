"""``meta.json`` beside a ``motion.npz``: HDMI keeps the names of joints and bodies in it."""

import json
from collections import ChainMap
from collections.abc import Mapping
from pathlib import Path
from typing import Any, cast

import numpy as np

from tlr_exp.motion.importers.raw import MotionFileError

FILE = "meta.json"
_MAX_BYTES = 1 << 20
_FITS = {"joint_names": "joint_pos", "body_names": "body_pos_w"}


def with_metadata(
    content: Mapping[str, Any], path: Path
) -> tuple[Mapping[str, Any], tuple[str, ...]]:
    """The content of a file and what the ``meta.json`` beside it adds, with a note of that.

    Only arrays of bodies without names are looked after; a ``meta.json`` that is none, or whose
    names are not as many as joints and bodies, is left aside, and that is noted.
    """
    if not set(_FITS.values()) <= set(content) or "joint_names" in content:
        return content, ()
    beside = path.with_name(FILE)
    try:
        if not beside.is_file() or beside.stat().st_size > _MAX_BYTES:
            return content, ()
        said = json.loads(beside.read_bytes())
    except (OSError, ValueError, RecursionError):
        return content, (f"the {FILE} beside it cannot be read and is not used",)
    if not _fits(said, content):
        return content, (f"the {FILE} beside it does not fit and is not used",)
    added = {key: said[key] for key in (*_FITS, "fps") if key in said and key not in content}
    both = ChainMap(added, cast("dict[str, Any]", content))
    return both, (f"{', '.join(added)} from the {FILE} beside it",)


def _fits(said: Any, content: Mapping[str, Any]) -> bool:
    if not isinstance(said, dict) or not set(_FITS) <= set(said):
        return False
    for names, array in _FITS.items():
        values, shape = said[names], _shape(content, array)
        texts = isinstance(values, list) and all(isinstance(value, str) for value in values)
        if not texts or len(shape) < 2 or shape[1] != len(values):
            return False
    return True


def _shape(content: Mapping[str, Any], key: str) -> tuple[int, ...]:
    try:
        array = content[key]
    except MotionFileError:
        return ()
    return array.shape if isinstance(array, np.ndarray) else ()
