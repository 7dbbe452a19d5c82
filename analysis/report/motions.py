"""Gathers what a report on several motions says before the reports on each of them."""

import io
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from typing import Any

import numpy as np
from matplotlib.backends.backend_pdf import PdfPages

from analysis.data.study import Study, pretty_arm
from analysis.figures.drawing import Drawing
from analysis.figures.motions import figure_motions, figure_profiles
from analysis.figures.style import styled
from analysis.measures.motions import LAST_FIFTH, OverMotions, over_motions
from analysis.report.answer import banner, change_text, together
from analysis.report.cells import Table, interval_text, number, p_value_text
from analysis.report.content import Report, picture_of, repeating, without_nan
from analysis.report.evidence import Evidence
from analysis.report.latex import latex_of
from analysis.report.sections import Picture, Section
from analysis.statistics.intervals import relative_improvement_interval
from analysis.statistics.motions import (
    PooledRatio,
    interquartile_means,
    performance_profiles,
    pooled_probability,
    pooled_ratio,
)
from analysis.statistics.results import Interval
from analysis.statistics.significance import holm
from tlr_exp import keys

SEED = 0  # of the resamples
# What the answer is told by, the first of them that there is: upper and lower body.
_TOLD_BY = (
    ("upper_body_error_m", "lower_body_error_m"),
    (keys.TRAIN_UPPER_BODY_ERROR, keys.TRAIN_LOWER_BODY_ERROR),
)
_THRESHOLDS = np.linspace(0.5, 1.5, 101)


def gather_motions(
    studies: Mapping[str, Study],
    commands: str | Sequence[str],
    pages: Mapping[str, str],
    progress: Callable[[str], None] = lambda _: None,
) -> Report:
    """The report on all motions together, for the baseline and the treatment of each study.

    Args:
        studies: by motion, with the same arms.
        commands: the command that repeats the studies, or those of their runs.
        pages: by motion, where the report on it lies.

    Raises:
        StudyError: the studies have one arm only.
    """
    progress("all motions together")
    first = Evidence(next(iter(studies.values())))
    found = over_motions(studies, first.treatment)
    told = _told(found)
    compared = [Compared(measure) for measure in found]
    pooled = _pooled(compared)
    drawings = _drawings(studies, first.treatment, [each for each in compared if each.of in told])
    pictures, pdf = _drawn(drawings)
    command, every = repeating([*studies.values()], commands)
    return Report(
        title=f"{first.versus}, {len(studies)} motions",
        subtitle=_subtitle(studies),
        banner=banner(first.study),
        answer=_answer(first, studies, [each for each in compared if each.of in told]),
        carrier=pictures[0] if pictures else None,
        summary=tuple(f"{motion}: {page}" for motion, page in pages.items()),
        command=command,
        commands=every,
        sections=(
            Section("motions", "Motion by motion", tables=_by_motion(compared, pages)),
            Section("pooled", "All motions together", _PARAGRAPHS, tables=(pooled,)),
            Section("figures", "Figures", pictures=pictures),
        ),
        numbers=without_nan({"motions": [each.numbers for each in compared]}),
        figures_pdf=pdf,
        latex=latex_of(pooled, f"{first.versus}. {pooled.note}"),
    )


class Compared:
    """One measure compared on every motion and over all of them."""

    def __init__(self, measure: OverMotions) -> None:
        self.of = measure
        better = {"smaller_is_better": not measure.shown.larger_is_better}
        strata = [*measure.baseline.values()], [*measure.treatment.values()]
        self.by_motion: dict[str, Interval] = {
            motion: relative_improvement_interval(values, measure.treatment[motion], **better)
            for motion, values in measure.baseline.items()
        }
        self.pooled: PooledRatio = pooled_ratio(*strata, **better)
        random = np.random.default_rng(SEED)
        self.interquartile = interquartile_means(*strata, generator=random)
        self.probability = pooled_probability(*strata, generator=random, **better)
        self.strata, self.better = strata, better

    @property
    def numbers(self) -> dict[str, Any]:
        """For programs."""
        return {
            "measure": self.of.measure,
            "endpoint": self.of.endpoint,
            "by_motion": {motion: asdict(each) for motion, each in self.by_motion.items()},
            "pooled": asdict(self.pooled),
            "interquartile_means": [*self.interquartile[:2], asdict(self.interquartile[2])],
            "probability_of_improvement": asdict(self.probability),
        }


def _told(found: Sequence[OverMotions]) -> list[OverMotions]:
    for names in _TOLD_BY:
        told = [each for each in found if each.measure in names]
        if len(told) == len(names):
            return told
    return []


# --- words -----------------------------------------------------------------------------------
_PARAGRAPHS = (
    "Values are divided by the baseline's mean on the same motion, so that hard and easy motions "
    "count alike. The motions are those of this study: the intervals say what other seeds would "
    "give, not what other motions would.",
)


def _subtitle(studies: Mapping[str, Study]) -> str:
    seeds = sorted({len(study.seeds(arm)) for study in studies.values() for arm in study.arms})
    arms = " and ".join(pretty_arm(arm) for arm in next(iter(studies.values())).arms)
    counts = " to ".join(map(str, dict.fromkeys((seeds[0], seeds[-1]))))
    return f"{', '.join(studies)}; {counts} seeds of {arms} on each."


def _answer(
    evidence: Evidence, studies: Mapping[str, Study], told: Sequence[Compared]
) -> tuple[str, str, str]:
    baseline, treatment = evidence.labels
    if not told:
        nothing = "These data have no tracking error that all runs of both arms share."
        return nothing, "", _worth(studies)
    pooled = [each.pooled.improvement for each in told]
    changes = ", ".join(
        f"its {each.of.shown.name.lower()} is {change_text(each.pooled.improvement)}"
        for each in told
    )
    where = "in training" if told[0].of.endpoint == LAST_FIFTH else "without exploration noise"
    over = (
        f"Over {len(studies)} motions, {where}, {treatment} tracks {together(pooled)} {baseline}: "
        f"{changes}."
    )
    kinds: dict[str, list[str]] = {"better": [], "worse": [], "not told apart": []}
    for motion, interval in told[0].by_motion.items():
        kind = "not told apart"
        if interval.low > 0:
            kind = "better"
        elif interval.high < 0:
            kind = "worse"
        kinds[kind].append(motion)
    parts = [f"{kind} on {', '.join(names)}" for kind, names in kinds.items() if names]
    each = f"Motion by motion, by its {told[0].of.shown.name.lower()}: {'; '.join(parts)}."
    return over, each, _worth(studies)


def _worth(studies: Mapping[str, Study]) -> str:
    fewest = min(len(study.seeds(arm)) for study in studies.values() for arm in study.arms)
    return (
        f"The units are seeds, {fewest} or more of each arm on each motion; no interval here says "
        "what other motions would give."
    )


# --- tables ----------------------------------------------------------------------------------
def _by_motion(compared: Sequence[Compared], pages: Mapping[str, str]) -> tuple[Table, ...]:
    header = ("measure", *pages)
    rows = tuple(
        (each.of.name, *(interval_text(i, 1, percent=True) for i in each.by_motion.values()))
        for each in compared
    )
    note = (
        "Improvement of the mean in shares of the baseline's, positive is better, with Fieller's "
        "95 % interval over seeds. The report on each motion has its tests: "
        f"{', '.join(pages.values())}."
    )
    return (Table("Improvement by motion", header, rows, note),)


def _pooled(compared: Sequence[Compared]) -> Table:
    header = (
        *("measure", "improvement over all motions", "p (t over motions, Holm)"),
        *("interquartile means (baseline, treatment)", "probability of improvement"),
    )
    adjusted = holm([each.pooled.test.p_value for each in compared])
    rows = tuple(
        (
            each.of.name,
            interval_text(each.pooled.improvement, 1, percent=True),
            p_value_text(p_value),
            f"{number(each.interquartile[0], 3)}, {number(each.interquartile[1], 3)}; difference "
            f"{interval_text(each.interquartile[2], 3)}",
            interval_text(each.probability, 2),
        )
        for each, p_value in zip(compared, adjusted, strict=True)
    )
    note = (
        "Improvement: of the geometric mean over motions of the ratios of means, with a 95 % "
        "interval and p by t over motions. Interquartile means: of all runs in shares of the "
        "baseline's mean on their motion. Probability: that a run of the treatment is better than "
        "one of the baseline on the same motion. Their intervals: bootstrap within motions. p is "
        "adjusted for the number of measures."
    )
    return Table("Pooled over motions", header, rows, note)


# --- figures ---------------------------------------------------------------------------------
def _drawings(
    studies: Mapping[str, Study], treatment: str, told: Sequence[Compared]
) -> list[Drawing]:
    if not told:
        return []
    columns = [(each.of, each.by_motion, each.pooled.improvement) for each in told]
    drawings = [figure_motions(studies, treatment, columns)]
    if np.isfinite(told[0].probability.low):
        random = np.random.default_rng(SEED)
        first = told[0]
        profiles = performance_profiles(
            *first.strata, _THRESHOLDS, generator=random, **first.better
        )
        drawings.append(figure_profiles(studies, treatment, first.of, profiles))
    return drawings


@styled  # the PDF writes its fonts as it closes, by the style that is in force then
def _drawn(drawings: Sequence[Drawing]) -> tuple[tuple[Picture, ...], bytes]:
    pictures, buffer = [], io.BytesIO()
    with PdfPages(buffer, metadata={"CreationDate": None}) as pages:
        for drawing in drawings:
            pictures.append(picture_of(drawing))
            pages.savefig(drawing.figure)
    return tuple(pictures), buffer.getvalue()
