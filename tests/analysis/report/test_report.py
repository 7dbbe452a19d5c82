"""The report as files: what stands in it, and that nothing is lost when it is written."""

import json
import re
import shutil
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from studies import make_study, with_starts

from analysis.commands import report as command
from analysis.data.tables import write_tables
from analysis.report.answer import change_text, support, together
from analysis.report.content import Report, gather
from analysis.report.pages import ReportExistsError, write_report
from analysis.statistics.results import Interval


@pytest.fixture(scope="module")
def report() -> Report:
    study = make_study(np.random.default_rng(0), ("fixed", "gwo", "random"), iterations=30)
    study = with_starts(study, np.random.default_rng(1))
    return gather(study, "make reproduce-paper SCALE=demo")


@pytest.fixture(scope="module")
def folder(report: Report, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("made") / "report"
    write_report(report, folder)
    return folder


class Page(HTMLParser):
    """Checks that elements close in order, and keeps what a browser would load from elsewhere."""

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.loaded: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        if tag not in ("meta", "img"):
            self.open.append(tag)
        self.loaded += [value or "" for name, value in attrs if name == "src"]

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag


def test_the_page_is_well_formed_and_self_contained(folder: Path) -> None:
    page = Page()
    page.feed((folder / "report.html").read_text())
    assert page.open == []
    assert len(page.loaded) >= 6
    assert all(source.startswith("data:image/svg+xml;base64,") for source in page.loaded)


def test_a_demo_says_that_it_is_no_evidence(folder: Path) -> None:
    for name in ("report.html", "report.md"):
        assert "Machinery, not evidence." in (folder / name).read_text()


def test_both_pages_hold_every_claim_every_table_and_the_command(folder: Path) -> None:
    html, markdown = ((folder / f"report.{kind}").read_text() for kind in ("html", "md"))
    for text in (
        "4.25 % better",
        "cannot be said",
        "Both upright, same seed and same phase",
        "Tracking and lower layer together",
        "two-layered (GWO) against static",
        "random weights against static",
        "False alarms under a true null",
        "make reproduce-paper SCALE=demo",
    ):
        assert text in html
        assert text in markdown


def test_the_answer_comes_first_with_the_figure_that_carries_it(
    report: Report, folder: Path
) -> None:
    html, markdown = ((folder / f"report.{kind}").read_text() for kind in ("html", "md"))
    before = html[: html.index("<h2")], markdown[: markdown.index("\n## ")]
    assert len(report.answer) == 3
    assert report.carrier.stem == "tradeoff"
    for text in before:
        assert all(sentence in text for sentence in report.answer)
        assert report.carrier.caption in text
        assert text.index("Repeat it") < text.index("make reproduce-paper SCALE=demo")
        assert report.summary[0] in text[text.index("<details>") : text.index("</details>")]
    assert before[0].count("<img") == 1


def test_contents_lead_to_every_section_table_and_figure(report: Report, folder: Path) -> None:
    html = (folder / "report.html").read_text()
    names = re.findall(r'\bid="([^"]+)"', html)
    assert len(set(names)) == len(names)
    links = re.findall(r'href="#([^"]+)"', html)
    assert set(links) <= set(names)
    parts = [section.tables + section.pictures for section in report.sections]
    assert len(links) == len(parts) + sum(map(len, parts))
    assert "prefers-color-scheme: dark" in html
    assert "@media print" in html


def test_figures_are_pages_of_a_pdf_and_the_comparison_is_a_latex_table(
    report: Report, folder: Path
) -> None:
    pdf = (folder / "figures.pdf").read_bytes()
    pages = sum(len(section.pictures) for section in report.sections)
    assert pdf.startswith(b"%PDF-")
    assert len(re.findall(rb"/Type /Page\b", pdf)) == pages
    assert b"CreationDate" not in pdf
    assert b"/Type3" not in pdf  # fonts that some journals refuse
    latex = (folder / "comparison.tex").read_text()
    assert latex.count("begin{tabular}") == 1
    assert "Upper-body error, last 20 \\%" in latex
    assert "Lower-layer cost" in latex


def test_every_row_of_the_markdown_tables_has_the_cells_of_its_header(folder: Path) -> None:
    width = 0
    for line in (folder / "report.md").read_text().splitlines():
        cells = len(re.findall(r"(?<!\\)\|", line)) if line.startswith("|") else 0
        assert cells in (0, width) or width == 0
        width = cells


def test_figures_are_there_as_vectors_and_pixels(folder: Path) -> None:
    stems = {path.stem for path in (folder / "figures").glob("*.svg")}
    assert {"figure_06_episode_length", "figure_14_weights"} <= stems
    assert stems == {path.stem for path in (folder / "figures").glob("*.png")}


def test_numbers_for_programs_are_strict_json(folder: Path) -> None:
    numbers = json.loads((folder / "statistics.json").read_text(), parse_constant=pytest.fail)
    gwo = numbers["outcomes"]["gwo"]
    assert {"gwo", "random"} == set(numbers["outcomes"])
    assert gwo[0]["unpaired"]["baseline"]["num_seeds"] == 5
    # A bootstrap of five seeds is refused; what is not known is null.
    assert gwo[0]["unpaired"]["bootstrap_difference"]["low"] is None


def test_a_report_is_not_replaced_unless_asked(report: Report, folder: Path) -> None:
    before = (folder / "report.html").read_bytes()
    with pytest.raises(ReportExistsError, match="--force"):
        write_report(report, folder)
    assert (folder / "report.html").read_bytes() == before
    write_report(report, folder, replace=True)
    assert (folder / "report.html").read_bytes() == before  # the same data, the same bytes
    assert [path.name for path in folder.parent.iterdir()] == ["report"]


def test_what_is_no_part_of_a_report_stays_when_it_is_replaced(
    report: Report, folder: Path, tmp_path: Path
) -> None:
    page = Path(shutil.copytree(folder, tmp_path / "report")) / "report.html"
    notes, mine = page.parent / "notes.txt", page.parent / "figures" / "mine.png"
    notes.write_text("of a reader")
    mine.write_bytes(b"a figure of a reader")
    page.write_text("old")
    fewer = [replace(each, pictures=each.pictures[:1]) for each in report.sections]
    write_report(replace(report, sections=tuple(fewer)), page.parent, replace=True)
    assert notes.read_text() == "of a reader"
    assert page.read_text() != "old"
    figures = {path.name for path in mine.parent.iterdir()}
    assert figures == {
        "mine.png",
        "figure_06_episode_length.svg",
        "figure_06_episode_length.png",
    }


def test_another_folder_is_never_replaced(report: Report, tmp_path: Path) -> None:
    (tmp_path / "thesis.tex").write_text("years of work")
    with pytest.raises(ReportExistsError, match="holds no report"):
        write_report(report, tmp_path, replace=True)
    assert (tmp_path / "thesis.tex").read_text() == "years of work"


@pytest.mark.parametrize(
    ("low", "high", "words"),
    [
        (0.01, 0.05, "support an improvement"),
        (-0.05, -0.01, "is worse"),
        (-0.01, 0.05, "do not tell the arms apart"),
        (float("nan"), float("nan"), "Nothing can be concluded"),
    ],
)
def test_the_summary_says_plainly_what_the_data_show(low: float, high: float, words: str) -> None:
    assert words in support(Interval(0.0, low, high, 0.95, "Fieller", "one seed"))


def test_an_improvement_is_said_as_larger_or_smaller() -> None:
    worse = Interval(-0.254, -0.274, -0.234, 0.95, "Fieller")
    assert change_text(worse) == "25.4\u00a0% larger [23.4,\u00a027.4]"
    unsure = Interval(0.03, -0.01, 0.07, 0.95, "Fieller")
    assert change_text(unsure) == "3.0\u00a0% smaller [-1.0,\u00a07.0]"
    alone = Interval(0.03, float("nan"), float("nan"), 0.95, "Fieller", "one seed")
    assert change_text(alone) == "3.0\u00a0% smaller"


BETTER = Interval(0.2, 0.1, 0.3, 0.95, "Fieller")
WORSE = Interval(-0.2, -0.3, -0.1, 0.95, "Fieller")
OPEN = Interval(0.0, -0.1, 0.1, 0.95, "Fieller")


@pytest.mark.parametrize(
    ("upper", "lower", "said"),
    [
        (BETTER, BETTER, "better than"),
        (WORSE, WORSE, "worse than"),
        (OPEN, OPEN, "in a way that these seeds do not tell from"),
        (BETTER, OPEN, "better in one body and no worse in the other than"),
        (OPEN, BETTER, "better in one body and no worse in the other than"),
        (BETTER, WORSE, "better in one body and worse in the other than"),
        (WORSE, BETTER, "better in one body and worse in the other than"),
        (WORSE, OPEN, "worse in one body and no better in the other than"),
        (OPEN, WORSE, "worse in one body and no better in the other than"),
    ],
)
def test_two_errors_together_are_called_what_they_are(upper, lower, said):
    assert together([upper, lower]) == said


def test_a_study_without_a_static_arm_is_not_held_against_the_paper() -> None:
    arms = ("gwo, threshold_share=0.02", "gwo, threshold_share=0.1")
    study = make_study(np.random.default_rng(0), arms, range(3), iterations=20, effect=0.3)
    report = gather(study, "tlr-train -m +sweep=threshold")
    assert "claims" not in {section.anchor for section in report.sections}
    (sweep,) = [section for section in report.sections if section.anchor == "sweep"]
    assert sweep.title == "What reward.objective.threshold_share does"
    by_value, tests = sweep.tables
    assert [row[0] for row in by_value.rows] == [
        "two-layered (GWO), 0.02",
        "two-layered (GWO), 0.1",
    ]
    assert [row[0] for row in tests.rows] == [
        "Upper-body error",
        "Lower-body error",
        "Episode length",
    ]
    assert not any("the paper:" in sentence for sentence in report.summary)
    assert report.summary[0].endswith("two-layered (GWO), threshold_share=0.1 is better.")


def test_the_command_writes_a_report_from_exported_tables(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    study = make_study(np.random.default_rng(0), seeds=(0, 1), iterations=20)
    write_tables(study, tmp_path / "results")
    assert command.main([str(tmp_path / "results"), "-o", str(tmp_path / "report")]) == 0
    assert "report.html" in capsys.readouterr().out
    assert "tlr-train optimizer=gwo seed=1" in (tmp_path / "report" / "report.md").read_text()


def test_the_command_names_what_is_wrong(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert command.main([str(tmp_path / "absent"), "-o", str(tmp_path / "report")]) == 1
    assert "absent" in capsys.readouterr().err
    assert not (tmp_path / "report").exists()


def test_an_occupied_place_is_refused_before_anything_is_computed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "notes.txt").touch()
    assert command.main(["absent", "-o", str(tmp_path)]) == 1
    assert "holds no report" in capsys.readouterr().err
