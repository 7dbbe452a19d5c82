"""What every command does before anything else, so that no machine's settings end it."""

import sys
from contextlib import suppress
from io import TextIOWrapper


def show_any_text() -> None:
    """Let what a terminal, a pipe or a locale cannot show be replaced, instead of ending a command.

    Under LANG=C or Latin-1 not every sign can be encoded, and paths may hold bytes that are no text
    in any encoding.
    """
    for stream in (sys.stdout, sys.stderr):
        # Streams that somebody has put in the place of these may have no encoding at all.
        if isinstance(stream, TextIOWrapper):
            with suppress(OSError, ValueError):
                stream.reconfigure(errors="replace")


def refuse_without_docstrings(program: str) -> None:
    """Leave with status 2 under ``python -OO``, by which TorchRL cannot be imported.

    Raises:
        SystemExit: docstrings are taken out.
    """
    if sys.flags.optimize >= 2:
        print(
            f"{program}: python -OO (PYTHONOPTIMIZE=2) takes out the docstrings, and TorchRL "
            "cannot be imported without them; run it by python, or by python -O",
            file=sys.stderr,
        )
        sys.exit(2)
