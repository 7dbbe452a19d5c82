"""Results of commands: nothing that is there is replaced without being told to."""

from collections.abc import Iterable
from pathlib import Path


def check_free(paths: Iterable[Path], force: bool) -> None:
    """Refuse places where something is, before minutes of work.

    Raises:
        FileExistsError: names the first of them, unless ``force`` is given.
    """
    existing = [] if force else [path for path in paths if path.exists()]
    if existing:
        raise FileExistsError(f"{existing[0]} exists; --force replaces it")
