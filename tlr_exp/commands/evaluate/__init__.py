"""tlr-evaluate: how well trained policies track their motion; tables, pictures, viewers."""

import argparse
from pathlib import Path

from tlr_exp.commands.arguments import (
    add_force,
    add_viewers,
    drawn_as,
    size_argument,
    viewer_of,
)
from tlr_exp.errors import UserError
from tlr_exp.evaluation.choosing import choose, is_folder_of_runs
from tlr_exp.evaluation.conditions import conditions
from tlr_exp.machine.terminal import EXIT_WRONG, add_version, command, refuse_without_docstrings

DISTURBED_STARTS = 16  # of --disturb where --starts does not say


@command("tlr-evaluate", status=EXIT_WRONG)
def main(arguments: list[str] | None = None) -> int:
    """The command line; returns the exit status: 0, or 2 for an error told in one line.

    1 where some of several runs could not be measured.
    """
    refuse_without_docstrings("tlr-evaluate")
    options = _parser().parse_args(arguments)
    if options.disturb is not None and options.starts is None:
        options.starts = DISTURBED_STARTS
    # What takes seconds to import is imported where it is needed: mistakes show before that.
    _check(options)
    return _run(options)


def _run(given: argparse.Namespace) -> int:
    """Hand what was asked for to the part of the command that does it, as plain values."""
    viewer = viewer_of(given.view, given.web)
    if given.strip:
        from tlr_exp.commands.evaluate.comparing import Checkpoints, compare

        which = Checkpoints(given.physics, given.checkpoint, given.iterations, given.shares)
        look = {"columns": given.columns, **drawn_as(given.size, given.quality)}
        compare(given.runs, which, given.output, given.force, **look)
        return 0
    if _measures_several(given):
        from tlr_exp.commands.evaluate.studying import study

        which = (given.checkpoint, given.physics)
        how = (given.starts, given.jobs, given.output, given.force)
        return study(given.runs, *which, *how, conditions(given.disturb or ()))
    choice = choose(given.runs[0], given.checkpoint, given.physics)
    if viewer is not None:
        from tlr_exp.commands.evaluate.watching import watch

        watch(choice, viewer)
    else:
        from tlr_exp.commands.evaluate.measuring import Pictures, measure

        look = drawn_as(given.size, given.quality)
        drawn = Pictures(given.pictures, given.video, given.columns, look)
        measure(choice, given.starts or 1, drawn, given.output, given.force)
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
        help="run directory or checkpoint file; with --starts, several or a folder of runs",
    )
    parser.add_argument("--physics", help="engine (default: the one used in training)")
    _add_starts(parser)
    what = parser.add_mutually_exclusive_group()
    what.add_argument(
        "--strip",
        action="store_true",
        help="draw the runs below their reference, one PNG per checkpoint (Figures 9-12)",
    )
    add_viewers(what)
    _add_checkpoints(parser)
    _add_pictures(parser)
    return parser


def _add_starts(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--starts",
        type=int,
        metavar="N",
        help="make N roll-outs, from evenly spaced phases of the motion to its end; report each, "
        "and their mean and spread (default: 1, from phase 0). For several runs, or the finished "
        "runs in a folder: numbers only, measured where missing, and a CSV of all roll-outs",
    )
    parser.add_argument(
        "--disturb",
        nargs="+",
        metavar="NAME=VALUE,…",
        help="measure each run undisturbed and under each of these, such as push=0.5 "
        "delay=20,40 mass=1.1+friction=0.5; a table, a CSV and a figure (default of --starts: "
        f"{DISTURBED_STARTS}; docs/disturbances.md explains the names)",
    )
    parser.add_argument(
        "--jobs",
        type=int,
        metavar="J",
        help="with --starts and several runs: J at a time, each with one thread (default: one per "
        "core)",
    )


def _add_checkpoints(parser: argparse.ArgumentParser) -> None:
    which = parser.add_mutually_exclusive_group()
    which.add_argument(
        "--checkpoint",
        metavar="best|last|ITERATION",
        help="which checkpoint (default: best, if there is one)",
    )
    which.add_argument(
        "--iterations", type=_numbers(int), metavar="N,N,…", help="with --strip: these iterations"
    )
    which.add_argument(
        "--shares",
        type=_numbers(float),
        metavar="%,%,…",
        help="with --strip: at these shares of each training (default: the paper's 4,20,40,88)",
    )


def _add_pictures(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--video",
        action=argparse.BooleanOptionalAction,
        help="draw the video (default: if this machine can draw)",
    )
    parser.add_argument(
        "--pictures",
        action=argparse.BooleanOptionalAction,
        help="draw curves of the errors, and keyframes (default: keyframes if this machine can "
        "draw, curves always)",
    )
    parser.add_argument("--columns", type=int, default=8, help="moments of a strip (default: 8)")
    parser.add_argument(
        "--size",
        type=size_argument,
        metavar="WxH",
        help="size of the video in pixels; with --strip, of each picture in the strip",
    )
    parser.add_argument(
        "--quality",
        choices=["fast", "full"],
        help="quality of the video (default: fast); with --strip, of the strip (default: full)",
    )
    parser.add_argument(
        "-o",
        "--output",
        type=Path,
        metavar="PATH",
        help="folder (default: RUN/eval); with --strip, the PNG (default: strip.png); with "
        "--starts and several runs, the CSV (default: starts-N.csv, in the folder of runs if one "
        "is given), and with --disturb disturbed-N.csv",
    )
    add_force(parser, "existing pictures and numbers")


def _check(options: argparse.Namespace) -> None:
    """Refuse what does not go together, before anything slow is loaded."""
    if len(options.runs) > 1 and not options.strip and options.starts is None:
        raise UserError(
            f"{len(options.runs)} runs can be compared with --strip or measured with --starts; "
            "otherwise give one"
        )
    for name in ("iterations", "shares"):
        if getattr(options, name) is not None and not options.strip:
            raise UserError(f"--{name} needs --strip")
    for name in ("starts", "jobs"):
        if getattr(options, name) is not None and getattr(options, name) < 1:
            raise UserError(f"--{name} is {getattr(options, name)}; it must be at least 1")
    conditions(options.disturb or ())
    if options.starts is not None and (options.strip or viewer_of(options.view, options.web)):
        given = "--starts" if options.disturb is None else "--disturb"
        raise UserError(f"{given} is for numbers: leave out --strip, --view and --web")
    if options.jobs is not None and not _measures_several(options):
        raise UserError("--jobs is for --starts with several runs, or a folder of runs")
    if _measures_several(options) and (options.video or options.pictures):
        raise UserError("of several runs there are numbers alone: no --video and no --pictures")
    if options.columns < 1:
        raise UserError(f"--columns is {options.columns}; it must be at least 1")


def _measures_several(options: argparse.Namespace) -> bool:
    """Whether a CSV is asked for: --starts, with several runs or with a folder; or --disturb."""
    several = len(options.runs) > 1 or is_folder_of_runs(options.runs[0])
    return options.starts is not None and (several or options.disturb is not None)


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
