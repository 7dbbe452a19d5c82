"""What a report says, gathered from a study; `pages` lays it out."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict, dataclass, field
from functools import partial
from typing import Any

import numpy as np

from analysis.figures.catalogue import ALL_FIGURES
from analysis.figures.drawing import NotDrawnError
from analysis.figures.false_positives import figure_false_positives
from analysis.figures.style import render
from analysis.quantities import quantity
from analysis.report import comparison_tables, protocol_tables, run_tables, sweep_tables
from analysis.report.cells import Table, duration, interval_text
from analysis.report.claims import (
    FULL_SIZE_SHARE,
    PAPER_CONTROL_STEPS,
    Claim,
    Finding,
    Verdict,
    findings,
)
from analysis.report.evidence import SEED, Evidence, seed_noise
from analysis.report.outcomes import Outcome, outcomes
from analysis.settings import RECIPE, setting
from analysis.statistics.nulls import FalsePositiveRates, false_positive_rates
from analysis.statistics.results import Interval
from analysis.study import Study, pretty_arm
from analysis.swept import sweep_of
from tlr_exp import keys

Progress = Callable[[str], None]

# Per cent, five seeds, Figure 13.
PAPER_IMPROVEMENT = {keys.TRAIN_UPPER_BODY_ERROR: 4.25, keys.TRAIN_LOWER_BODY_ERROR: 4.98}
SEEDS_TEXT = (
    "A method is judged by what it does on a new seed, so the seed is the unit: one number per "
    "run, compared between the arms. A table of many tests is many chances to be lucky; the "
    "column Holm allows for those of one table, not for other arms in further tables, and the "
    "intervals, the summary's included, are each by itself."
)
SWEEP_TEXT = (
    "All values together: with a table of many pairs, the best of them looks good by chance. The "
    "tests ask first whether the value matters at all."
)
PROTOCOL_TEXT = (
    "The paper prints p-values and names no test. Five seeds cannot give such values, whatever the "
    "data; a test over the iterations of averaged curves can. That it was this one is a conjecture; "
    "it is made here to compare like with like, and the tables say what it is worth."
)


@dataclass(frozen=True)
class Picture:
    """A figure as files, with what stands beside it."""

    stem: str
    title: str
    caption: str
    paper: str
    width_in: float
    svg: bytes
    png: bytes


@dataclass(frozen=True)
class Section:
    """A part of the page: paragraphs, then tables, then pictures."""

    anchor: str
    title: str
    paragraphs: tuple[str, ...] = ()
    tables: tuple[Table, ...] = ()
    pictures: tuple[Picture, ...] = ()
    missing: tuple[str, ...] = ()  # figures that could not be drawn, with the reason


@dataclass(frozen=True)
class Report:
    """A whole report, without any layout."""

    title: str
    subtitle: str
    banner: str  # empty where the runs are evidence for something
    summary: tuple[str, ...]
    command: str
    sections: tuple[Section, ...]
    numbers: dict[str, Any] = field(repr=False)


def gather(study: Study, command: str, progress: Progress = lambda _: None) -> Report:
    """Everything that the report of a study says.

    Args:
        study: the checked runs.
        command: the command that repeats the study.
        progress: told what is being computed, since tests and figures take a minute together.

    Raises:
        StudyError: the study has one arm only.
    """
    evidence = Evidence(study)
    progress("statistics")
    judged = findings(evidence) if evidence.is_the_papers else []
    found = {arm: outcomes(Evidence(study, arm)) for arm in study.arms[1:]}
    progress("false alarms of both protocols")
    rates = null_rates(evidence)
    figures = Section("figures", "Figures", **draw_all(study, rates, progress))
    return Report(
        title=f"{evidence.labels[1]} against {evidence.labels[0]}",
        subtitle=_subtitle(study),
        banner=_banner(study),
        summary=tuple(_summary(evidence, judged)),
        command=command,
        sections=(
            *_claims_section(judged),
            _seeds_section(study, found),
            *_sweep_section(study),
            _protocol_section(evidence, rates),
            figures,
            _runs_section(study),
        ),
        numbers=_numbers(judged, found, rates),
    )


def null_rates(evidence: Evidence) -> dict[str, FalsePositiveRates]:
    """False alarms of both protocols in simulated studies as this one, without any true difference.

    By tracking error: number of seeds and iterations, autocorrelation of neighbouring iterations
    and the spread between seeds are those of this study's curves of it.
    """
    return {metric: _null_rates(evidence, metric) for metric in protocol_tables.BODIES}


def _null_rates(evidence: Evidence, metric: str) -> FalsePositiveRates:
    first, second = evidence.curves(metric)
    noise = seed_noise(first, second)
    num_seeds = max(2, min(len(first), len(second)))
    return false_positive_rates(
        num_seeds=num_seeds,
        num_iterations=first.shape[1],
        autocorrelation=noise.autocorrelation,
        between_seed_sd=noise.between_seed_sd,
        generator=np.random.default_rng(SEED),
    )


def draw_all(
    study: Study, rates: Mapping[str, FalsePositiveRates], progress: Progress
) -> dict[str, Any]:
    """Every figure that the study has the data for ("pictures"), and why others are "missing".

    `rates` by metric, of simulated studies stand in the figure of false alarms beside those of this study.
    """
    simulated = {"false_positives": partial(figure_false_positives, simulated=rates)}
    pictures, missing = [], []
    for number, spec in enumerate(ALL_FIGURES, 1):
        progress(f"figure {number} of {len(ALL_FIGURES)}")
        try:
            drawing = simulated.get(spec.stem, spec.draw)(study)
        except NotDrawnError as reason:
            missing.append(f"{spec.stem} ({reason})")
            continue
        files = render(drawing.figure, "svg"), render(drawing.figure, "png")
        words = drawing.title, drawing.caption, spec.paper
        pictures.append(Picture(spec.stem, *words, drawing.figure.get_figwidth(), *files))
    return {"pictures": tuple(pictures), "missing": tuple(missing)}


# --- words -----------------------------------------------------------------------------------
def _subtitle(study: Study) -> str:
    runs = study.runs
    seeds = " / ".join(str(len(study.seeds(arm))) for arm in study.arms)
    size = f"{runs['num_envs'].iloc[0]} environments, {study.iterations} iterations"
    motion = ", ".join(sorted(runs["motion"].unique()))
    scale = ", ".join(sorted(runs["scale"].unique()))
    recipe = ", ".join(sorted({setting(json.loads(c), RECIPE) or "paper" for c in runs["config"]}))
    arms = ", ".join(pretty_arm(arm) for arm in study.arms)
    return (
        f"Motion {motion}; scale {scale}: {size}; recipe {recipe}; arms: {arms}; "
        f"seeds per arm: {seeds}."
    )


def _banner(study: Study) -> str:
    """What a run of this scale is evidence for, where that is nothing."""
    if "demo" not in set(study.runs["scale"]):
        return ""
    config = json.loads(study.runs["config"].iloc[0])
    evidence = config["scale"].get("evidence", "shows that the machinery works")
    return f"A run of this scale {evidence}."


def _summary(evidence: Evidence, judged: list[tuple[Claim, Finding]]) -> Iterator[str]:
    for metric, claimed in PAPER_IMPROVEMENT.items():
        interval = evidence.relative_improvement(metric)
        text = interval_text(interval, 1, percent=True)
        theirs = f" (the paper: +{claimed} %). {support(interval)}" if judged else ""
        yield (
            f"{quantity(metric).name}, mean over training: relative improvement of "
            f"{evidence.labels[1]} over {evidence.labels[0]} "
            f"{text}{theirs or '. ' + conclusion(interval, evidence)}"
        )
    if judged:
        counts = {verdict: sum(f.verdict == verdict for _, f in judged) for verdict in Verdict}
        told = ", ".join(f"{count} {verdict.value}" for verdict, count in counts.items() if count)
        yield f"Of {len(judged)} claims of the paper: {told}."
    share = evidence.control_steps_per_run / PAPER_CONTROL_STEPS
    if share < FULL_SIZE_SHARE:
        yield (
            f"Each run took {evidence.control_steps_per_run:.3g} control steps, "
            f"{100 * share:.2g} % of the paper's. What happens later in training, these data "
            "cannot say."
        )
    yield from evidence.study.notes


def support(interval: Interval) -> str:
    """In plain words, whether the seeds show the improvement that the paper reports."""
    if math.isnan(interval.low):
        return f"Nothing can be concluded: {interval.reason}."
    if interval.low > 0:
        return "These data support an improvement."
    if interval.high < 0:
        return "These data do not support the paper: the two-layered arm is worse."
    return "These data do not support the paper: they do not tell the arms apart."


def conclusion(interval: Interval, evidence: Evidence) -> str:
    """In plain words, which of two arms the seeds show to be the better one."""
    if math.isnan(interval.low):
        return f"Nothing can be concluded: {interval.reason}."
    if interval.low > 0:
        return f"{evidence.labels[1]} is better."
    if interval.high < 0:
        return f"{evidence.labels[0]} is better."
    return "These seeds do not tell the arms apart."


# --- sections --------------------------------------------------------------------------------
def _claims_section(judged: list[tuple[Claim, Finding]]) -> Iterator[Section]:
    if judged:
        yield Section("claims", "Claims", tables=(comparison_tables.claims_table(judged),))


def _seeds_section(study: Study, found: dict[str, list[Outcome]]) -> Section:
    content = []
    for arm, of_arm in found.items():
        evidence = Evidence(study, arm)
        content += [
            comparison_tables.seeds_table(evidence, of_arm),
            comparison_tables.tests_table(evidence, of_arm),
            comparison_tables.curves_table(evidence),
            comparison_tables.speed_table(evidence),
        ]
    return Section("seeds", "The seed as the unit", (SEEDS_TEXT,), tuple(content))


def _sweep_section(study: Study) -> Iterator[Section]:
    sweep = sweep_of(study)
    if sweep is not None:
        content = (sweep_tables.values_table(study, sweep), sweep_tables.trend_table(study, sweep))
        yield Section("sweep", f"What {sweep.key} does", (SWEEP_TEXT,), content)


def _protocol_section(evidence: Evidence, rates: Mapping[str, FalsePositiveRates]) -> Section:
    content = (
        protocol_tables.protocol_table(evidence),
        protocol_tables.units_table(evidence),
        protocol_tables.false_positive_table(rates),
    )
    return Section("protocol", "The paper's protocol", (PROTOCOL_TEXT,), content)


def _runs_section(study: Study) -> Section:
    content = (
        run_tables.runs_table(study),
        run_tables.environment_table(study),
        run_tables.terms_table(study),
        run_tables.settings_table(study),
    )
    return Section("runs", "What was run", (_cost(study),), content)


def _cost(study: Study) -> str:
    seconds = f"{keys.TIME_PREFIX}iteration_s"
    if seconds not in study.metric_names:
        return ""
    hours = float(study.curves[seconds].to_numpy().sum()) / 3600
    return f"Together the runs took {duration(hours)} of iterations, on {len(study.runs)} runs."


def _numbers(
    judged: list[tuple[Claim, Finding]],
    found: dict[str, list[Outcome]],
    rates: Mapping[str, FalsePositiveRates],
) -> dict[str, Any]:
    """The statistics for programs; what the data do not allow is null."""
    claims = [
        {"statement": c.statement, "paper": c.paper, **asdict(f), "verdict": f.verdict.value}
        for c, f in judged
    ]
    numbers = {
        "claims": claims,
        "outcomes": {arm: [asdict(each) for each in of_arm] for arm, of_arm in found.items()},
        "false_positive_rates": {name: asdict(each) for name, each in rates.items()},
    }
    return _without_nan(numbers)


def _without_nan(node: Any) -> Any:
    if isinstance(node, dict):
        return {name: _without_nan(value) for name, value in node.items()}
    if isinstance(node, list | tuple):
        return [_without_nan(value) for value in node]
    if isinstance(node, float) and not math.isfinite(node):
        return None
    return node
