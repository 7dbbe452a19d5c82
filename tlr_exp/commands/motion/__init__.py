"""tlr-motion: bring motions of other projects in, check, repair and join clips, look at them."""

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
        description="Import motions from other projects; check, repair and look at clips.",
    )
    add_version(parser)
    commands = parser.add_subparsers(required=True, metavar="COMMAND")
    importing.add_arguments(commands.add_parser("import", help="make a clip from a motion file"))
    checking.add_arguments(commands.add_parser("check", help="find physical faults in clips"))
    joining.add_arguments(commands.add_parser("join", help="join clips one after the other"))
    showing.add_arguments(commands.add_parser("show", help="draw a video, keyframes and curves"))
    looking.add_info(commands.add_parser("info", help="say what a clip contains"))
    looking.add_list(commands.add_parser("list", help="list the authored motions"))
    return parser
