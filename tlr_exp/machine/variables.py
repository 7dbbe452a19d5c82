"""The environment variables that the program reads, what each means, and a function for each.

Those by which a sweep speaks to its jobs, and those of a cluster's scheduler and of MLflow's
client, stand where that is done.
"""

import os
from pathlib import Path

TRACKING_URI = "MLFLOW_TRACKING_URI"  # the MLflow store
MAX_FILE_MB = "TLR_SYNC_MAX_FILE_MB"  # the largest file that is brought into it
GRAPHICS = "MUJOCO_GL"  # how MuJoCo draws off screen, or that it does not
_DISPLAYS = ("DISPLAY", "WAYLAND_DISPLAY")
_CACHE = "XDG_CACHE_HOME"


def tracking_uri() -> str:
    """The MLflow store; empty where none is named."""
    return os.environ.get(TRACKING_URI, "")


def max_file_mb() -> str:
    """Megabytes of the largest file for MLflow, as written; empty where nothing is."""
    return os.environ.get(MAX_FILE_MB, "")


def graphics() -> str:
    """The way of drawing that is wanted, in small letters; empty where any will do."""
    return os.environ.get(GRAPHICS, "").lower().strip()


def has_display() -> bool:
    """Whether a display of X11 or Wayland is named."""
    return any(os.environ.get(name) for name in _DISPLAYS)


def cache_folder() -> Path | None:
    """Where this program may keep what can be made again; None for a user without a home."""
    root = os.environ.get(_CACHE, "")
    try:
        return (Path(root) if os.path.isabs(root) else Path.home() / ".cache") / "tlr_exp"
    except RuntimeError:
        return None
