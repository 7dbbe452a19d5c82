"""tlr-export: write the runs of a study as tables that can be published and analysed again."""

import argparse
import shlex
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from analysis.commands.sources import (
    add_selection,
    add_sources,
    advice,
    check_sources,
    source_names,
    studies_of,
)
from analysis.data.starts import STARTS
from analysis.data.study import Study
from analysis.data.tables import CURVES, FILES, RUNS, is_occupied, write_motions, write_tables
from tlr_exp.machine.terminal import add_version, command
from tlr_exp.records.places import plain_command

_EPILOG = """\
The following are refused, and the message names them: unfinished runs, seeds that one arm has and
another lacks, two runs of the same arm and seed, and settings that differ apart from the arms and
the seed. Different commits, versions and machines are noted in the manifest.

Hosts are numbered, and paths outside the current folder are reduced to their last part, so the
tables name neither people nor machines.
"""


@command("tlr-export")
def main(arguments: Sequence[str] | None = None) -> None:
    """Entry point. 0: written; 1: refused, nothing was written; 2: wrong arguments."""
    parser = export_parser()
    options = parser.parse_args(arguments)
    check_sources(parser, options)
    words = sys.argv[1:] if arguments is None else list(arguments)
    with advice():
        is_occupied(options.output, options.force)  # before runs are loaded
        studies = studies_of(options)
        told = {
            "source": source_names(options),
            "command": plain_command(shlex.join(["tlr-export", *words])),
            "force": options.force,
        }
        if len(studies) == 1:
            (study,) = studies.values()
            _export(study, options.output, **told)
            return
        for motion, study in studies.items():
            _export(study, options.output / motion, **told)
        write_motions(options.output, {motion: motion for motion in studies})


def _export(study: Study, folder: Path, **told: Any) -> None:
    manifest = write_tables(study, folder, **told)
    for line in _report(study, folder):
        print(line)
    for note in manifest["notes"]:
        print(f"  note: {note}")


def export_parser() -> argparse.ArgumentParser:
    """The parser of tlr-export."""
    parser = argparse.ArgumentParser(
        prog="tlr-export",
        description="Write the runs of a study as tables that can be published and analysed again.",
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add_version(parser)
    add_sources(parser)
    add_selection(parser)
    parser.add_argument(
        *("-o", "--output"), metavar="FOLDER", type=Path, required=True, help="new or empty folder"
    )
    parser.add_argument(
        "--force",
        action="store_true",
        help=f"replace {', '.join(FILES)} and {STARTS} in a FOLDER that is not empty",
    )
    return parser


def _report(study: Study, folder: Path) -> list[str]:
    size = sum((folder / name).stat().st_size for name in (RUNS, CURVES))
    lines = [
        f"{folder}: {len(study.runs)} runs, {study.iterations} iterations, "
        f"{len(study.metric_names)} metrics, {size / 1e6:.2f} MB"
    ]
    if len(study.starts):
        lines.append(f"  roll-outs from start phases: {len(study.starts)}")
    for arm in study.arms:
        lines.append(f"  {arm}: seeds {', '.join(map(str, study.seeds(arm)))}")
    return lines


if __name__ == "__main__":
    sys.exit(main())
