"""``tlr-report``: from the runs of a study, or from exported tables, to the report."""

import argparse
import sys
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

from analysis.commands.sources import (
    add_selection,
    add_sources,
    advice,
    check_sources,
    studies_of,
)
from analysis.data.study import Study
from analysis.report.content import Report, gather
from analysis.report.motions import gather_motions
from analysis.report.pages import PAGE, check_place, write_report
from tlr_exp.machine.terminal import add_version, command


@command("tlr-report")
def main(arguments: Sequence[str] | None = None) -> None:
    """Entry point. 0: written; 1: refused, nothing was written; 2: wrong arguments."""
    parser = report_parser()
    options = parser.parse_args(arguments)
    check_sources(parser, options)
    with advice():
        check_place(options.output, options.force)  # before a minute of statistics
        studies = studies_of(options)
        for motion in studies if len(studies) > 1 else ():
            check_place(options.output / motion, options.force)
        for folder, report in _reports(studies, options.repeat):
            page = write_report(report, options.output / folder, options.force)
            print(page)


def _reports(studies: Mapping[str, Study], repeat: str | None) -> Iterator[tuple[str, Report]]:
    """The reports with the folders to put them into: of several motions first that of all."""

    def progress(step: str) -> None:
        print(f"  {step} …", flush=True)

    commands = {motion: study.runs["command"].tolist() for motion, study in studies.items()}
    if len(studies) == 1:
        ((motion, study),) = studies.items()
        yield "", gather(study, repeat or commands[motion], progress)
        return
    every = repeat or [each for own in commands.values() for each in own]
    yield "", gather_motions(studies, every, {name: f"{name}/{PAGE}" for name in studies}, progress)
    for motion, study in studies.items():
        progress(f"the motion {motion}")
        yield motion, gather(study, commands[motion], progress)


def report_parser() -> argparse.ArgumentParser:
    """The parser of tlr-report."""
    parser = argparse.ArgumentParser(
        prog="tlr-report",
        description="Write the report of a study: report.html, which needs no other file, the same "
        "as report.md, its figures (one by one, and as figures.pdf), comparison.tex (the main "
        "comparison as a LaTeX table), and statistics.json.",
    )
    add_version(parser)
    add_sources(parser)
    add_selection(parser)
    parser.add_argument(
        *("-o", "--output"), metavar="FOLDER", type=Path, required=True, help="new or empty folder"
    )
    parser.add_argument(
        "--repeat",
        metavar="COMMAND",
        help="command to show for repeating the study (default: the sweep of its runs)",
    )
    parser.add_argument("--force", action="store_true", help="replace an existing report")
    return parser


if __name__ == "__main__":
    sys.exit(main())
