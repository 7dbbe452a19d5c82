"""``tlr-report``: from an exported study to its report."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from analysis.report.content import gather
from analysis.report.pages import ReportExistsError, write_report
from analysis.study import StudyError
from analysis.tables import from_tables

EXIT_FAILED, EXIT_INPUT = 1, 2


def main(arguments: list[str] | None = None) -> None:
    """Entry point of ``tlr-report``."""
    options = _parser().parse_args(arguments)
    try:
        page = report(options.results, options.output, options.repeat, options.force)
    except (StudyError, ReportExistsError) as error:
        print(error, file=sys.stderr)
        sys.exit(EXIT_INPUT)
    except OSError as error:
        print(f"cannot write the report: {error}", file=sys.stderr)
        sys.exit(EXIT_FAILED)
    print(f"report    {page}")


def report(results: Path, output: Path, repeat: str | None, force: bool) -> Path:
    """Write the report of the exported study in `results` into `output`; the path of its page.

    `repeat` is the command that repeats the study; None: the commands of its runs.

    Raises:
        StudyError: no study, a damaged one, or one that compares nothing.
        ReportExistsError: `output` holds something.
        OSError: it cannot be written.
    """
    study = from_tables(results)
    command = repeat or "\n".join(dict.fromkeys(study.runs["command"]))
    gathered = gather(study, command, lambda step: print(f"  {step} …", flush=True))
    return write_report(gathered, output, force)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="tlr-report",
        description="Write the report of an exported study (tlr-export): report.html, report.md, "
        "figures/ and statistics.json.",
    )
    parser.add_argument("results", type=Path, help="folder that tlr-export wrote")
    parser.add_argument("-o", "--output", type=Path, required=True, help="folder of the report")
    parser.add_argument("--repeat", help="the command that repeats the study, to be shown")
    parser.add_argument("--force", action="store_true", help="replace a report that is there")
    return parser


if __name__ == "__main__":
    main()
