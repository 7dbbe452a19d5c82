"""Results of commands: nothing that is there is replaced without being told to."""

import argparse
from collections.abc import Iterable
from pathlib import Path


def add_force(parser: argparse.ArgumentParser, what: str) -> None:
    """The option --force; ``what`` says in the help what it replaces."""
    parser.add_argument("--force", action="store_true", help=f"replace {what}")


def check_free(paths: Iterable[Path], force: bool) -> None:
    """Refuse places where something is, before minutes of work.

    Raises:
        FileExistsError: names the first of them, unless ``force`` is given.
    """
    existing = [] if force else [path for path in paths if path.exists()]
    if existing:
        raise FileExistsError(f"{existing[0]} exists; --force replaces it")
