"""Writes a report: one self-contained page, the same in Markdown, figures, LaTeX, and JSON."""

import base64
import json
import os
import re
import tempfile
from pathlib import Path

from jinja2 import Environment, PackageLoader, StrictUndefined

from analysis.figures.catalogue import ALL_FIGURES
from analysis.figures.motions import OF_MOTIONS
from analysis.report.content import Report
from analysis.report.judging.verdicts import Verdict
from tlr_exp.errors import UserError

PAGE, MARKDOWN, NUMBERS, FIGURES = "report.html", "report.md", "statistics.json", "figures"
FIGURES_PDF, LATEX = "figures.pdf", "comparison.tex"
BESIDE = (FIGURES_PDF, LATEX, NUMBERS, MARKDOWN)


class ReportExistsError(UserError):
    """A report is there already and was not to be replaced; the message says how."""


def write_report(report: Report, folder: Path, replace: bool = False) -> Path:
    """Write all files of a report into `folder`; the path of the page.

    Everything is laid out beside the folder first and then moved in, the page last. What lies in
    the folder and is no part of a report stays.

    Raises:
        ReportExistsError: the folder holds something, and `replace` was not asked for.
        OSError: the folder cannot be written.
    """
    folder = folder.absolute()
    check_place(folder, replace)
    folder.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=folder.parent, prefix=f".{folder.name}-") as beside:
        _write_files(report, Path(beside))
        _move_in(Path(beside), folder)
    return folder / PAGE


def check_place(folder: Path, replace: bool = False) -> None:
    """Refuse to put a report where something else is, or a report that may not be replaced.

    Raises:
        ReportExistsError: the folder holds something; the message says how to go on.
    """
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        if folder.is_dir() and not (folder / PAGE).is_file():
            raise ReportExistsError(f"{folder} holds no report, so it is not replaced")
        if not replace:
            raise ReportExistsError(f"{folder} holds something already; --force replaces it")


def _write_files(report: Report, folder: Path) -> None:
    (folder / FIGURES).mkdir(parents=True)
    for section in report.sections:
        for picture in section.pictures:
            (folder / FIGURES / f"{picture.stem}.svg").write_bytes(picture.svg)
            (folder / FIGURES / f"{picture.stem}.png").write_bytes(picture.png)
    (folder / FIGURES_PDF).write_bytes(report.figures_pdf)
    (folder / LATEX).write_text(report.latex, encoding="utf-8")
    templates = _templates()
    for name in (PAGE, MARKDOWN):
        verdicts = [verdict.value for verdict in Verdict]
        text = templates.get_template(f"{name}.j2").render(report=report, verdicts=verdicts)
        (folder / name).write_text(text.strip() + "\n", encoding="utf-8")
    numbers = json.dumps(report.numbers, indent=2, allow_nan=False, sort_keys=True)
    (folder / NUMBERS).write_text(numbers + "\n", encoding="utf-8")


def _move_in(fresh: Path, folder: Path) -> None:
    """Move the files of a report into its folder, and remove figures that it has no more."""
    (folder / FIGURES).mkdir(parents=True, exist_ok=True)
    figures = sorted(each.name for each in (fresh / FIGURES).iterdir())
    for name in (*(f"{FIGURES}/{figure}" for figure in figures), *BESIDE, PAGE):
        os.replace(fresh / name, folder / name)
    stems = (*(spec.stem for spec in ALL_FIGURES), *OF_MOTIONS)
    ours = {f"{stem}.{suffix}" for stem in stems for suffix in ("svg", "png")}
    for name in ours.difference(figures):
        (folder / FIGURES / name).unlink(missing_ok=True)


def _templates() -> Environment:
    environment = Environment(
        loader=PackageLoader("analysis.report"),
        autoescape=lambda name: name is not None and ".html" in name,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["base64"] = lambda content: base64.b64encode(content).decode()
    environment.filters["slug"] = lambda text: re.sub(r"[^a-z0-9]+", "-", text.lower()).strip("-")
    # As GitHub makes the anchor of a heading.
    environment.filters["anchor"] = lambda text: re.sub(r"[^\w -]", "", text.lower()).replace(
        " ", "-"
    )
    environment.filters["cell"] = lambda text: text.replace("|", "\\|").replace("\n", " ")
    return environment
