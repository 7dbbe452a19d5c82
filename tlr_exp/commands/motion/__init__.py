"""tlr-motion: bring motions of other projects in, check, repair and join clips, look at them."""

from __future__ import annotations

import argparse
from collections.abc import Sequence

from tlr_exp.commands.motion import checking, importing, joining, looking, showing
from tlr_exp.commands.motion.files import ArgumentsError
from tlr_exp.machine.terminal import add_version, command


@command("tlr-motion", wrong=(ArgumentsError,))
def main(arguments: Sequence[str] | None = None) -> int | None:
    """Entry point. 0: done; 1: a file was refused or a clip is wrong; 2: wrong arguments."""
    options = vars(_parser().parse_args(arguments))
    run = options.pop("run")  # of a subcommand, which takes its options by their names
    return run(**options)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="tlr-motion",
        description="Bring motions in from other projects, check and repair clips, look at them.",
    )
    add_version(parser)
    commands = parser.add_subparsers(required=True, metavar="COMMAND")
    importing.add_arguments(commands.add_parser("import", help="make a clip from a motion file"))
    checking.add_arguments(commands.add_parser("check", help="what is physically wrong with clips"))
    joining.add_arguments(commands.add_parser("join", help="clips one after the other"))
    showing.add_arguments(commands.add_parser("show", help="video, keyframes and curves of a clip"))
    looking.add_info(commands.add_parser("info", help="what a clip holds"))
    looking.add_list(commands.add_parser("list", help="the authored motions"))
    return parser
