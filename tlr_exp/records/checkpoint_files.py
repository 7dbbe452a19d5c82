"""Which checkpoints lie in a folder, and which is best, without importing PyTorch."""

from __future__ import annotations

import json
import logging
from pathlib import Path

SUFFIX = ".pt"
SCORES = "scores.json"
CHECKPOINTS = "checkpoints"

_log = logging.getLogger(__name__)


def checkpoint_path(directory: Path, iteration: int) -> Path:
    """Where the checkpoint of `iteration` lies or would lie."""
    return directory / f"{iteration:06d}{SUFFIX}"


def checkpoint_iterations(directory: Path) -> list[int]:
    """The iterations that have a checkpoint in `directory`, ascending."""
    names = (path.stem for path in directory.glob(f"*{SUFFIX}"))
    return sorted(int(name) for name in names if name.isdecimal())


def read_scores(directory: Path) -> dict[int, float]:
    """Scores by iteration, as they were saved; none where the file is damaged (logged)."""
    try:
        scores = json.loads((directory / SCORES).read_text(encoding="utf-8"))
    except FileNotFoundError:
        return {}
    except (OSError, ValueError) as error:
        _log.warning("cannot read %s, so no checkpoint counts as best: %s", SCORES, error)
        return {}
    return {int(iteration): float(score) for iteration, score in scores.items()}


def best_iteration(directory: Path) -> int | None:
    """The iteration with the highest score, the earlier one of equals; None where none has one."""
    present = set(checkpoint_iterations(directory))
    scores = {key: score for key, score in read_scores(directory).items() if key in present}
    return min(scores, key=lambda key: (-scores[key], key)) if scores else None
