"""Begins and ends every command: any text can be shown, and errors are for people."""

import argparse
import functools
import sys
import traceback
from collections.abc import Callable
from contextlib import suppress
from io import TextIOWrapper
from typing import Any

from tlr_exp import __version__
from tlr_exp.errors import UserError

EXIT_FAILED, EXIT_WRONG, EXIT_INTERRUPTED = 1, 2, 130
EXPLAINED = (UserError, OSError)


def command(
    program: str,
    status: int = EXIT_FAILED,
    wrong: tuple[type[Exception], ...] = (),
    interrupted: str = "interrupted",
) -> Callable[[Callable[..., int | None]], Callable[..., int]]:
    """A decorator for the function that is a command: it returns the exit status, 0 for None.

    Errors that are explained, and Ctrl-C, are told on stderr without a traceback; all others are
    faults of the program, and are passed on.

    Args:
        program: its name, with which what is told begins.
        status: the exit status after an explained error ...
        wrong: ... but for these, which mean that it was asked for what cannot be: 2.
        interrupted: what is told after Ctrl-C, with exit status 130.
    """

    def decorate(main: Callable[..., int | None]) -> Callable[..., int]:
        @functools.wraps(main)
        def run(*arguments: Any) -> int:
            show_any_text()
            try:
                return main(*arguments) or 0
            except EXPLAINED as error:
                print(f"{program}: {error}", file=sys.stderr)
                return EXIT_WRONG if isinstance(error, wrong) else status
            except KeyboardInterrupt:
                print(f"{program}: {interrupted}", file=sys.stderr)
                return EXIT_INTERRUPTED

        return run

    return decorate


def add_version(parser: argparse.ArgumentParser) -> None:
    """The option --version of a command."""
    parser.add_argument("--version", action="version", version=version_of(parser.prog))


def version_of(program: str) -> str:
    """Name and version, as --version prints them."""
    return f"{program} {__version__}"


def print_error(error: BaseException) -> None:
    """Say on stderr what went wrong; with a traceback where the message does not say it all."""
    if isinstance(error, EXPLAINED):
        print(error, file=sys.stderr)
    else:
        traceback.print_exception(error)


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
        sys.exit(EXIT_WRONG)
