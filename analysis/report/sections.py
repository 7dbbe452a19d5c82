"""The parts of a report, one after the other: tables with the words that they need."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from analysis.data.study import Study
from analysis.measures.quantities import ITERATION_S, quantity_of_roll_out
from analysis.measures.swept import sweep_of
from analysis.report import comparison_tables, protocol_tables, study_tables
from analysis.report.cells import Table, duration
from analysis.report.evidence import BODIES, SEED, Evidence, seed_noise
from analysis.report.judging.claims import Judged, claims_table
from analysis.report.outcomes import (
    Outcome,
    lower_layer_outcomes,
    outcomes,
    same_phase_outcomes,
    tracking_outcomes,
)
from analysis.statistics.nulls import FalsePositiveRates, false_positive_rates

SEEDS_TEXT = (
    "A method is judged by what it does on a new seed, so the seed is the unit: one number per "
    "run, compared between the arms. A table of many tests is many chances to be lucky; the "
    "columns Holm allow for those of one table, not for other arms in further tables, and the "
    "intervals, the answer's included, are each by itself."
)
TRACKING_TEXT = (
    "In training, errors are measured under exploration noise, and depend on how long ago an "
    "episode was reset, in which arms can differ. Here the policies act without noise, from the "
    "same start phases in every run."
)
LOWER_LAYER_TEXT = (
    "Whether the lower layer gets better or only disappears: an arm that is asked for less may "
    "track better for that alone. So each cost of the lower layer is tested as the errors are, and "
    "both are seen together."
)
SWEEP_TEXT = (
    "All values together: with a table of many pairs, the best of them looks good by chance. The "
    "tests ask first whether the value matters at all."
)
PROTOCOL_TEXT = (
    "The paper prints p-values and names no test. Five seeds cannot give such values, whatever "
    "the data; a test over the iterations of averaged curves can. That it was this one is a "
    "conjecture; it is made here to compare like with like, and the tables say what it is worth."
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
class Found:
    """Everything that is compared between the baseline and one other arm, by family of tests."""

    training: list[Outcome]
    tracking: list[Outcome]
    same_phase: list[Outcome]
    lower_layer: list[Outcome]


def found_in(evidence: Evidence) -> Found:
    """Both arms compared in training, and without noise where that was measured."""
    return Found(
        outcomes(evidence),
        tracking_outcomes(evidence),
        same_phase_outcomes(evidence),
        lower_layer_outcomes(evidence),
    )


def null_rates(evidence: Evidence) -> dict[str, FalsePositiveRates]:
    """False alarms of both protocols in simulated studies as this one, without any true difference.

    By tracking error: number of seeds and iterations, autocorrelation of neighbouring iterations
    and the spread between seeds are those of this study's curves of it.
    """
    return {metric: _null_rates(evidence, metric) for metric in BODIES}


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


def claims_section(judged: Judged) -> Iterator[Section]:
    if judged:
        yield Section("claims", "Claims", tables=(claims_table(judged),))


def seeds_section(study: Study, found: Mapping[str, Found]) -> Section:
    content = []
    for arm, of_arm in found.items():
        evidence = Evidence(study, arm)
        content += [
            *_means_and_tests(evidence, of_arm.training),
            comparison_tables.curves_table(evidence),
            comparison_tables.speed_table(evidence),
        ]
    return Section("seeds", "The seed as the unit", (SEEDS_TEXT,), tuple(content))


def _means_and_tests(evidence: Evidence, found: list[Outcome]) -> list[Table]:
    tables = comparison_tables.seeds_table, comparison_tables.tests_table
    return [table(evidence, found) for table in tables]


def tracking_section(study: Study, found: Mapping[str, Found]) -> Iterator[Section]:
    """Roll-outs from many start phases, without noise, where the study has them."""
    content = []
    for arm, of_arm in found.items():
        evidence = Evidence(study, arm)
        if of_arm.tracking:
            content += _means_and_tests(evidence, of_arm.tracking)
        if of_arm.same_phase:
            content.append(comparison_tables.same_phase_table(evidence, of_arm.same_phase))
    if content:
        source = Evidence(study).rollouts
        said = f"Measured on {source.source}." if source else ""
        yield Section(
            "tracking", "Without exploration noise", (TRACKING_TEXT, said), tuple(content)
        )


def lower_layer_section(study: Study, found: Mapping[str, Found]) -> Section:
    """What the motion costs by the lower layer, and what that does to a comparison."""
    content = []
    for arm, of_arm in found.items():
        evidence = Evidence(study, arm)
        area = comparison_tables.area_table(evidence)
        content += [] if area is None else [area]
        if of_arm.lower_layer:
            content += _means_and_tests(evidence, of_arm.lower_layer)
    words = (LOWER_LAYER_TEXT, _cost_note(Evidence(study)))
    return Section("lower-layer", "The lower layer", words, tuple(content))


def _cost_note(evidence: Evidence) -> str:
    """What was measured on, and why there is no cost where there is none."""
    found = evidence.rollouts_with_terms
    if found is None:
        return "The study has no roll-out or evaluation without noise that all its runs have."
    if found.lacking:
        return f"Measured on {found.source}. There is no lower-layer cost: {found.lacking}."
    shown = quantity_of_roll_out("lower_layer_cost")
    unit = shown.unit if shown else ""
    return (
        f"Measured on {found.source}. The lower-layer cost ({unit}) is what the baseline's "
        "penalties would take at weights 1, in every arm alike: so an arm that trains without a "
        "penalty is asked what it costs all the same. Terms are means of their raw values."
    )


def sweep_section(study: Study) -> Iterator[Section]:
    sweep = sweep_of(study)
    if sweep is not None:
        content = (study_tables.values_table(study, sweep), study_tables.trend_table(study, sweep))
        yield Section("sweep", f"What {sweep.key} does", (SWEEP_TEXT,), content)


def protocol_section(evidence: Evidence, rates: Mapping[str, FalsePositiveRates]) -> Section:
    content = (
        protocol_tables.protocol_table(evidence),
        protocol_tables.units_table(evidence),
        protocol_tables.false_positive_table(rates),
    )
    return Section("protocol", "The paper's protocol", (PROTOCOL_TEXT,), content)


def runs_section(study: Study) -> Section:
    content = (
        study_tables.runs_table(study),
        study_tables.environment_table(study),
        study_tables.terms_table(study),
        study_tables.settings_table(study),
    )
    return Section("runs", "What was run", (_cost(study),), content)


def _cost(study: Study) -> str:
    if ITERATION_S not in study.metric_names:
        return ""
    hours = float(study.curves[ITERATION_S].to_numpy().sum()) / 3600
    return f"Together the runs took {duration(hours)} of iterations, on {len(study.runs)} runs."
