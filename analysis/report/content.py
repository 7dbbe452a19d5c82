"""Gathers what a report says from a study; `pages` lays it out."""

import io
import json
import math
import shlex
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from functools import partial
from itertools import product
from typing import Any

from matplotlib.backends.backend_pdf import PdfPages

from analysis.data.settings import RECIPE
from analysis.data.study import Study
from analysis.figures.catalogue import ALL_FIGURES
from analysis.figures.drawing import Drawing, NotDrawnError
from analysis.figures.false_positives import figure_false_positives
from analysis.figures.style import render, settle, styled
from analysis.report import answer, sections
from analysis.report.answer import CARRIERS
from analysis.report.evidence import Evidence
from analysis.report.judging.claims import Judged, findings
from analysis.report.latex import latex_table
from analysis.report.sections import Found, Picture, Section, found_in
from analysis.statistics.nulls import FalsePositiveRates
from tlr_exp.config.nested import value_at

Progress = Callable[[str], None]
_PROGRAMS = {"train.py": "tlr-train"}  # as the command calls itself where it is run as a file


@dataclass(frozen=True)
class Report:
    """A whole report, without any layout.

    answer: three sentences. carrier: the figure that carries them. summary: what is behind them.
    command: the one that repeats the study; commands: of every run, where there is not one alone.
    figures_pdf: all figures, a page each. latex: the main comparison as a table.
    """

    title: str
    subtitle: str
    banner: str  # empty where the runs are evidence for something
    answer: tuple[str, str, str]
    carrier: Picture | None
    summary: tuple[str, ...]
    command: str
    commands: tuple[str, ...]
    sections: tuple[Section, ...]
    numbers: dict[str, Any] = field(repr=False)
    figures_pdf: bytes = field(repr=False)
    latex: str = field(repr=False)


def gather(
    study: Study,
    commands: str | Sequence[str],
    progress: Progress = lambda _: None,
) -> Report:
    """Everything that the report of a study says.

    Args:
        study: the checked runs.
        commands: the command that repeats the study, or those of its runs.
        progress: told what is being computed, since tests and figures take a minute together.

    Raises:
        StudyError: the study has one arm only.
    """
    evidence = Evidence(study)
    progress("statistics")
    judged = findings(evidence) if evidence.is_the_papers else []
    found = {arm: found_in(Evidence(study, arm)) for arm in study.arms[1:]}
    progress("false alarms of both protocols")
    rates = sections.null_rates(evidence)
    pictures, missing, pdf = draw_all(study, rates, progress)
    command, every = repeating([study], commands)
    return Report(
        title=evidence.versus,
        subtitle=answer.subtitle(study),
        banner=answer.banner(study),
        answer=answer.answer(evidence, judged),
        carrier=carrier_of(pictures, evidence),
        summary=tuple(answer.summary(evidence, judged)),
        command=command,
        commands=every,
        sections=(
            *sections.claims_section(judged),
            *sections.tracking_section(study, found),
            sections.lower_layer_section(study, found),
            sections.seeds_section(study, found),
            *sections.sweep_section(study),
            sections.protocol_section(evidence, rates),
            Section("figures", "Figures", pictures=pictures, missing=missing),
            sections.runs_section(study),
        ),
        numbers=_numbers(evidence, judged, found, rates),
        figures_pdf=pdf,
        latex=_latex(evidence, found[evidence.treatment]),
    )


def _names_recipe(study: Study) -> bool:
    return any(value_at(json.loads(config), RECIPE) for config in study.runs["config"])


def carrier_of(pictures: Sequence[Picture], evidence: Evidence) -> Picture | None:
    """The figure that carries the answer, of those that were drawn.

    Not that of the lower layer where it had to be drawn from other roll-outs than the answer's.
    """
    drawn = {picture.stem: picture for picture in pictures}
    ours, drawn_from = evidence.rollouts, evidence.rollouts_with_terms
    if ours is None or drawn_from is None or ours.source != drawn_from.source:
        drawn.pop("tradeoff", None)
    return next((drawn[stem] for stem in CARRIERS if stem in drawn), None)


@styled  # the PDF writes its fonts as it closes, by the style that is in force then
def draw_all(
    study: Study, rates: Mapping[str, FalsePositiveRates], progress: Progress
) -> tuple[tuple[Picture, ...], tuple[str, ...], bytes]:
    """Every figure that the study has the data for, why others are missing, and a PDF of all.

    `rates` by metric, of simulated studies, stand in the figure of false alarms beside those of
    this study.
    """
    simulated = {"false_positives": partial(figure_false_positives, simulated=rates)}
    pictures, missing, buffer = [], [], io.BytesIO()
    with PdfPages(buffer, metadata={"CreationDate": None}) as pages:
        for number, spec in enumerate(ALL_FIGURES, 1):
            progress(f"figure {number} of {len(ALL_FIGURES)}")
            try:
                drawing = simulated.get(spec.stem, spec.draw)(study)
            except NotDrawnError as reason:
                missing.append(f"{spec.stem} ({reason})")
                continue
            pictures.append(picture_of(drawing, spec.paper))
            pages.savefig(drawing.figure)
            pages.attach_note(f"{drawing.title}. {drawing.caption}")
    return tuple(pictures), tuple(missing), buffer.getvalue()


def picture_of(drawing: Drawing, paper: str = "") -> Picture:
    """A drawing as files; `paper` is what it is there."""
    settle(drawing.figure)
    files = render(drawing.figure, "svg"), render(drawing.figure, "png")
    width = drawing.figure.get_figwidth()
    return Picture(drawing.stem, drawing.title, drawing.caption, paper, width, *files)


# --- the command that repeats it --------------------------------------------------------------
def repeating(
    studies: Sequence[Study], commands: str | Sequence[str]
) -> tuple[str, tuple[str, ...]]:
    """The command that repeats the studies; and those of all runs, where there are several.

    commands: the one that repeats them, or those of the runs.
    """
    each = (commands,) if isinstance(commands, str) else tuple(dict.fromkeys(commands))
    command = one_command(each)
    if command and not isinstance(commands, str) and not any(map(_names_recipe, studies)):
        command += " recipe=paper"  # all that there was before a recipe had a name
    told = command or f"{each[0]}  # one of {len(each)} runs, all of which are below"
    return told, () if len(each) == 1 else each


def one_command(commands: Sequence[str]) -> str:
    """The sweep that starts the same runs as ``commands`` do; empty where no one command does.

    Overrides in which the commands differ become lists, "seed=0,1,2", if the commands are every
    combination of their values. Of commands that are all the same, that one.
    """
    split = [_words(command) for command in dict.fromkeys(commands)]
    if not split or any(words is None for words in split):
        return ""
    programs, overrides = zip(*filter(None, split), strict=True)
    names = [list(each) for each in overrides]
    if len(set(programs)) > 1 or any(each != names[0] for each in names):
        return ""
    if len(split) == 1:
        return commands[0]
    values = {name: [*dict.fromkeys(each[name] for each in overrides)] for name in names[0]}
    made = {tuple(each.values()) for each in overrides}
    if made != set(product(*values.values())):
        return ""
    words = [f"{name}={','.join(each)}" for name, each in values.items()]
    return shlex.join([*shlex.split(programs[0]), "-m", *words])


def _words(command: str) -> tuple[str, dict[str, str]] | None:
    """Program (with its flags) and overrides of a command; None where it is not of that form."""
    try:
        first, *rest = shlex.split(command)
    except ValueError:
        return None
    flags = [word for word in rest if word.startswith("-")]
    pairs = [word.partition("=") for word in rest if not word.startswith("-")]
    if any(not equals for _, equals, _ in pairs) or len({name for name, _, _ in pairs}) < len(
        pairs
    ):
        return None
    program = shlex.join([_PROGRAMS.get(first, first), *flags])
    return program, {name: value for name, _, value in pairs}


# --- for programs and for papers --------------------------------------------------------------
def _latex(evidence: Evidence, found: Found) -> str:
    source = evidence.rollouts_with_terms
    groups = (
        ("in training and its evaluations", found.training),
        ("without exploration noise, from many start phases", found.tracking),
        (f"lower layer, {source.source if source else 'not measured'}", found.lower_layer),
    )
    baseline, treatment = evidence.labels
    caption = (
        f"{treatment} against {baseline}: mean ± standard deviation over seeds, difference "
        f"({treatment} less {baseline}) with Welch's interval. {answer.subtitle(evidence.study)}"
    )
    return latex_table(evidence, groups, caption)


def _numbers(
    evidence: Evidence,
    judged: Judged,
    found: Mapping[str, Found],
    rates: Mapping[str, FalsePositiveRates],
) -> dict[str, Any]:
    """The statistics for programs; what the data do not allow is null."""
    claims = [
        {"statement": c.statement, "paper": c.paper, **asdict(f), "verdict": f.verdict.value}
        for c, f in judged
    ]
    numbers = {
        "answer": answer.answer(evidence, judged),
        "claims": claims,
        "outcomes": {arm: [asdict(each) for each in of.training] for arm, of in found.items()},
        "without_noise": {
            arm: {
                family: [asdict(each) for each in getattr(of, family)]
                for family in ("tracking", "same_phase", "lower_layer")
            }
            for arm, of in found.items()
        },
        "false_positive_rates": {name: asdict(each) for name, each in rates.items()},
    }
    return without_nan(numbers)


def without_nan(node: Any) -> Any:
    """Numbers for JSON: what is not finite is null."""
    if isinstance(node, dict):
        return {name: without_nan(value) for name, value in node.items()}
    if isinstance(node, list | tuple):
        return [without_nan(value) for value in node]
    if isinstance(node, float) and not math.isfinite(node):
        return None
    return node
