"""Finds the checkpoints in a folder, and the best of them, without importing PyTorch."""

import json
import logging
from pathlib import Path

from tlr_exp.errors import UserError

SUFFIX = ".pt"
SCORES = "scores.json"
CHECKPOINTS = "checkpoints"
BEST, LAST = "best", "last"

_log = logging.getLogger(__name__)


def checkpoint_path(directory: Path, iteration: int) -> Path:
    """The path of the checkpoint of `iteration`, whether or not it exists."""
    return directory / f"{iteration:06d}{SUFFIX}"


def checkpoint_iterations(directory: Path) -> list[int]:
    """The iterations that have a checkpoint in `directory`, ascending."""
    names = (path.stem for path in directory.glob(f"*{SUFFIX}"))
    return sorted(int(name) for name in names if name.isdecimal())


def read_scores(directory: Path) -> dict[int, float]:
    """Scores by iteration, as they were saved; none where the file is damaged (logged)."""
    try:
        scores = json.loads((directory / SCORES).read_text(encoding="utf-8"))
        return {int(iteration): float(score) for iteration, score in scores.items()}
    except FileNotFoundError:
        return {}
    except (OSError, ValueError, TypeError, AttributeError) as error:
        _log.warning("cannot read %s, so no checkpoint counts as best: %s", SCORES, error)
        return {}


def best_iteration(directory: Path) -> int | None:
    """The iteration with the highest score, the earlier one of equals; None where none has one."""
    present = set(checkpoint_iterations(directory))
    scores = {key: score for key, score in read_scores(directory).items() if key in present}
    return min(scores, key=lambda key: (-scores[key], key)) if scores else None


def chosen_checkpoint(directory: Path, wanted: str | None = None) -> Path:
    """The file of the checkpoint asked for.

    Args:
        directory: holds checkpoints.
        wanted: ``best``, ``last`` or an iteration; by default the best, or else the last.

    Raises:
        ValueError: there is none of that name; lists those that there are.
    """
    iterations = checkpoint_iterations(directory)
    if not iterations:
        raise UserError(f"{directory} holds no checkpoint yet")
    best = best_iteration(directory)
    named = {
        **{str(iteration): iteration for iteration in iterations},
        **{LAST: iterations[-1], BEST: best, None: iterations[-1] if best is None else best},
    }
    iteration = named.get(str(int(wanted)) if wanted and wanted.isdecimal() else wanted)
    if iteration is None:
        names = [name for name, found in named.items() if name and found is not None]
        raise UserError(f"{directory} has no checkpoint {wanted!r}; it has {', '.join(names)}")
    return checkpoint_path(directory, iteration)


def initial_checkpoint(path: Path) -> Path:
    """The file that another run begins from: a checkpoint, or the best (else the last) of a run.

    Raises:
        ValueError: there is none.
    """
    if path.suffix == SUFFIX:
        if not path.is_file():
            raise UserError(f"there is no checkpoint {path}")
        return path
    if not path.is_dir():
        raise UserError(f"there is no folder {path}; a run or a checkpoint ({SUFFIX}) is needed")
    if not (path / CHECKPOINTS).is_dir():
        raise UserError(f"{path} is no run: it has no folder {CHECKPOINTS}")
    return chosen_checkpoint(path / CHECKPOINTS)
