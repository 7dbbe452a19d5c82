"""Checkpoints of a run: whole or absent, the last few, the best, and those asked for.

torchrl.checkpoint (0.14) publishes by rename but never calls fsync, and its rotation cannot keep
named iterations; hence this store.
"""

import io
import json
import logging
import math
import pickle
import zipfile
import zlib
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch

from tlr_exp.errors import UserError
from tlr_exp.records.checkpoint_files import (
    SCORES,
    SUFFIX,
    best_iteration,
    checkpoint_iterations,
    checkpoint_path,
    read_scores,
)
from tlr_exp.records.storage import atomic_write, storage_errors, temporary_name

_UNREADABLE = (
    OSError,
    EOFError,
    RuntimeError,
    ValueError,
    KeyError,
    pickle.UnpicklingError,
    zipfile.BadZipFile,
    zlib.error,
)
_PLAIN = (bool, int, float, str, type(None))

_log = logging.getLogger(__name__)


class CheckpointError(UserError):
    """A checkpoint cannot be read, or a state cannot be kept in one."""


@dataclass(frozen=True)
class LoadedCheckpoint:
    """A checkpoint read back: where it lies, its iteration, and the state as it was saved."""

    path: Path
    iteration: int
    state: dict[str, Any]


class CheckpointStore:
    """The checkpoints in one folder, ITERATION.pt each; one process saves, any may read.

    Kept are the last `keep_last`, the one with the highest score so far (`best`; the earlier one
    of equals), and those of `keep_iterations`. All others are deleted after each save.

    Raises:
        ValueError: `keep_last` is below 1.
    """

    def __init__(
        self, directory: str | Path, keep_last: int, keep_iterations: frozenset[int] = frozenset()
    ) -> None:
        if keep_last < 1:
            raise UserError(f"keep_last is {keep_last}: at least one checkpoint must be kept")
        self.directory = Path(directory)
        self.keep_last = keep_last
        self.keep_iterations = keep_iterations

    def save(self, iteration: int, state: Mapping[str, Any], score: float | None = None) -> Path:
        """Write `state` as the checkpoint of `iteration`, durably, and delete what is not kept.

        `state` is nested dicts, lists and tuples of tensors, Python numbers, strings and None.
        A NaN score counts as none.

        Raises:
            CheckpointError: the state holds something else (names where).
            StorageError: the disk is full, ...; all earlier checkpoints stay, no rest is left.
        """
        _require_plain(dict(state), "state")
        # Into memory first, so that no error of the serialisation leaves half a file behind.
        buffer = io.BytesIO()
        torch.save(dict(state), buffer)
        with storage_errors(f"cannot make {self.directory}", "Allow writing to it and resume."):
            self.directory.mkdir(parents=True, exist_ok=True)
        self._clear_rests()
        # Before the file: a score whose file is missing is passed over, while a file that lost its
        # score to a kill could be deleted though it is the best.
        self._write_score(iteration, score)
        path = self.path_of(iteration)
        atomic_write(path, buffer.getbuffer())
        self._prune()
        return path

    def path_of(self, iteration: int) -> Path:
        """The path of the checkpoint of `iteration`, whether or not it exists."""
        return checkpoint_path(self.directory, iteration)

    def iterations(self) -> list[int]:
        """The iterations that have a checkpoint, ascending."""
        return checkpoint_iterations(self.directory)

    def best(self) -> Path | None:
        """The file with the highest score, None where no checkpoint has a score."""
        iteration = best_iteration(self.directory)
        return None if iteration is None else self.path_of(iteration)

    def latest_valid(
        self, map_location: str | torch.device | None = "cpu"
    ) -> LoadedCheckpoint | None:
        """The newest checkpoint that can be read; a damaged one is named in a logged warning.

        None where there is no checkpoint at all.

        Raises:
            CheckpointError: there are checkpoints, and none can be read.
        """
        iterations = self.iterations()
        for iteration in reversed(iterations):
            path = self.path_of(iteration)
            try:
                return LoadedCheckpoint(path, iteration, load_checkpoint(path, map_location))
            except CheckpointError as error:
                _log.warning("%s; trying the checkpoint before it", error)
        if iterations:
            raise CheckpointError(f"none of the checkpoints in {self.directory} can be read")
        return None

    # --- scores and deletion -----------------------------------------------------------------
    def _write_score(self, iteration: int, score: float | None) -> None:
        before = read_scores(self.directory)
        present = set(self.iterations())
        scores = {key: value for key, value in before.items() if key in present}
        scores.pop(iteration, None)
        if score is not None and not math.isnan(score):
            scores[iteration] = float(score)
        if scores != before:
            text = json.dumps({str(key): scores[key] for key in sorted(scores)})
            atomic_write(self.directory / SCORES, text.encode())

    def _prune(self) -> None:
        iterations = self.iterations()
        best = best_iteration(self.directory)
        kept = {*iterations[-self.keep_last :], *self.keep_iterations, best}
        for iteration in iterations:
            if iteration not in kept:
                self.path_of(iteration).unlink(missing_ok=True)

    def _clear_rests(self) -> None:
        """Delete what a save that was killed left behind."""
        for rest in self.directory.glob(temporary_name(Path(f"*{SUFFIX}")).name):
            with suppress(OSError):
                rest.unlink()


def load_checkpoint(
    path: str | Path, map_location: str | torch.device | None = "cpu"
) -> dict[str, Any]:
    """The state saved in `path`, its tensors on `map_location` (None: where they were).

    Reads data only (weights_only), so a checkpoint from elsewhere cannot run code.

    Raises:
        CheckpointError: the file is missing, cut off, damaged, or not a checkpoint.
    """
    path = Path(path)
    try:
        # torch.load does not compare the checksums that torch.save wrote.
        with zipfile.ZipFile(path) as archive:
            damaged = archive.testzip()
        if damaged is not None:
            raise UserError(f"{damaged} in it is damaged")
        state = torch.load(path, map_location=map_location, weights_only=True)
    except FileNotFoundError as error:
        raise CheckpointError(f"there is no checkpoint {path}") from error
    except _UNREADABLE as error:
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise CheckpointError(f"cannot read checkpoint {path} ({reason})") from error
    if not isinstance(state, dict):
        raise CheckpointError(f"{path} holds a {type(state).__name__}, not a checkpoint")
    return state


def _require_plain(value: Any, where: str) -> None:
    """Refuse at saving what `weights_only` would refuse at loading, when it is too late."""
    if isinstance(value, torch.Tensor) or type(value) in _PLAIN:
        return
    if isinstance(value, dict):
        for key, item in value.items():
            if type(key) not in (str, int):
                raise CheckpointError(f"{where} has the key {key!r}: must be a string or an int")
            _require_plain(item, f"{where}[{key!r}]")
        return
    if type(value) in (list, tuple):
        for index, item in enumerate(value):
            _require_plain(item, f"{where}[{index}]")
        return
    raise CheckpointError(
        f"{where} is a {type(value).__name__}: a checkpoint holds tensors, Python numbers, "
        "strings, None, and dicts, lists or tuples of them"
    )
