"""tlr-evaluate: how well trained policies track their motion; tables, pictures, viewers."""

from __future__ import annotations

import argparse
from pathlib import Path

from tlr_exp.evaluation.choosing import Choice, choose, is_folder_of_runs, load_policy
from tlr_exp.machine.terminal import EXIT_WRONG, add_version, command, refuse_without_docstrings
from tlr_exp.pictures.sizes import size_argument
from tlr_exp.records.outputs import add_force
from tlr_exp.viewing.options import add_viewers, check_port, viewer_wanted

__all__ = ["Choice", "choose", "load_policy", "main"]


@command("tlr-evaluate", status=EXIT_WRONG)
def main(arguments: list[str] | None = None) -> int:
    """The command line; returns the exit status: 0, or 2 for an error told in one line.

    1 where some of several runs could not be measured.
    """
    refuse_without_docstrings("tlr-evaluate")
    options = _parser().parse_args(arguments)
    # What takes seconds to import is imported where it is needed: mistakes show before that.
    _check(options)
    return _run(options)


def _run(options: argparse.Namespace) -> int:
    if options.strip:
        from tlr_exp.commands.evaluate.comparing import compare

        compare(options)
    elif _measures_several(options):
        from tlr_exp.commands.evaluate.studying import study

        return study(options)
    elif viewer_wanted(options):
        from tlr_exp.commands.evaluate.watching import watch

        watch(options)
    else:
        from tlr_exp.commands.evaluate.measuring import measure

        measure(options)
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="tlr-evaluate",
        description="Run a trained policy through its motion (once, from phase 0, unless --starts "
        "says otherwise), without exploration noise and without termination. Writes a table, JSON, "
        "pictures and a video; or draws the policies of several runs in one strip; or shows the "
        "policy in a viewer.",
    )
    add_version(parser)
    parser.add_argument(
        "runs",
        type=Path,
        nargs="+",
        metavar="RUN",
        help="run directory, or a checkpoint file; with --starts several, or a folder of runs",
    )
    parser.add_argument("--physics", help="engine (default: the one trained on)")
    parser.add_argument(
        "--starts",
        type=int,
        metavar="N",
        help="N roll-outs, from evenly spaced phases of the motion to its end; their mean and "
        "spread, and each (default: 1, from phase 0). Of several runs, or of the finished runs in "
        "a folder: numbers alone, of those not measured yet, and a CSV of all roll-outs",
    )
    parser.add_argument(
        "--jobs",
        type=int,
        metavar="J",
        help="with --starts and several runs: J at a time, each with one thread (default: as many "
        "as there are cores)",
    )
    what = parser.add_mutually_exclusive_group()
    what.add_argument(
        "--strip",
        action="store_true",
        help="draw the runs below their reference, one PNG a checkpoint (Figures 9-12)",
    )
    add_viewers(what)
    _add_checkpoints(parser)
    _add_pictures(parser)
    return parser


def _add_checkpoints(parser: argparse.ArgumentParser) -> None:
    which = parser.add_mutually_exclusive_group()
    which.add_argument(
        "--checkpoint",
        metavar="best|last|ITERATION",
        help="which checkpoint (default: best, where there is one)",
    )
    which.add_argument(
        "--iterations", type=_numbers(int), metavar="N,N,…", help="with --strip: these iterations"
    )
    which.add_argument(
        "--shares",
        type=_numbers(float),
        metavar="%,%,…",
        help="with --strip: at these shares of each training (default: 4,20,40,88, as the paper)",
    )


def _add_pictures(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--video",
        action=argparse.BooleanOptionalAction,
        help="draw the video (default: where this machine can draw)",
    )
    parser.add_argument(
        "--pictures",
        action=argparse.BooleanOptionalAction,
        help="draw curves of the errors, and keyframes (default: the keyframes where this machine "
        "can draw, the curves always)",
    )
    parser.add_argument("--columns", type=int, default=8, help="moments of a strip (default: 8)")
    parser.add_argument(
        "--size",
        type=size_argument,
        metavar="WxH",
        help="pixels of the video; with --strip, of one of its pictures",
    )
    parser.add_argument(
        "--quality",
        choices=["fast", "full"],
        help="of the video (default: fast); with --strip, of the strip (default: full)",
    )
    parser.add_argument(
        "-o",
        "--output",
        type=Path,
        metavar="PATH",
        help="folder (default: RUN/eval); with --strip the PNG (default: strip.png); with --starts "
        "and several runs the CSV (default: starts-N.csv, in the folder of runs if one is given)",
    )
    add_force(parser, "pictures and numbers that exist")


def _check(options: argparse.Namespace) -> None:
    """Refuse what does not go together, before anything slow is loaded."""
    if len(options.runs) > 1 and not options.strip and options.starts is None:
        raise ValueError(
            f"{len(options.runs)} runs are compared with --strip, or measured with --starts; "
            "else give one"
        )
    for name in ("iterations", "shares"):
        if getattr(options, name) is not None and not options.strip:
            raise ValueError(f"--{name} needs --strip")
    for name in ("starts", "jobs"):
        if getattr(options, name) is not None and getattr(options, name) < 1:
            raise ValueError(f"--{name} is {getattr(options, name)}; it must be at least 1")
    if options.starts is not None and (options.strip or viewer_wanted(options)):
        raise ValueError("--starts is for numbers: without --strip, --view and --web")
    if options.jobs is not None and not _measures_several(options):
        raise ValueError("--jobs is for --starts with several runs, or a folder of runs")
    if _measures_several(options) and (options.video or options.pictures):
        raise ValueError("of several runs there are numbers alone: no --video and no --pictures")
    if options.columns < 1:
        raise ValueError(f"--columns is {options.columns}; it must be at least 1")
    check_port(options)


def _measures_several(options: argparse.Namespace) -> bool:
    """Whether numbers of several runs are asked for: --starts, with several or with a folder."""
    several = len(options.runs) > 1 or is_folder_of_runs(options.runs[0])
    return options.starts is not None and several


def _numbers(kind: type):
    def read(text: str) -> list:
        try:
            numbers = [kind(part) for part in text.split(",")]
        except ValueError:
            numbers = []
        if not numbers or min(numbers) <= 0:
            raise argparse.ArgumentTypeError(f"{text!r} is no list of positive numbers like 4,20")
        return numbers

    return read
