"""Tables of a sweep over a number: results at every value, and tests of all values together."""

from collections.abc import Iterator

import numpy as np

from analysis.data.study import Study, pretty_arm
from analysis.measures.quantities import TRAINING, quantity
from analysis.measures.swept import Sweep, end_of_training
from analysis.report.cells import NBSP, Table, number, p_text
from analysis.report.evidence import SEED, Evidence
from analysis.report.outcomes import digits_of
from analysis.statistics.trend import trend


def metrics_of(study: Study) -> tuple[str, ...]:
    """The metrics of training that the runs of every arm have."""
    pairs = [Evidence(study, arm) for arm in study.arms[1:]]
    return tuple(metric for metric in TRAINING if all(pair.has(metric) for pair in pairs))


def values_table(study: Study, sweep: Sweep) -> Table:
    """Mean and spread over seeds of every metric, a row per value, then the other arms."""
    rows = [
        _values_row(study, f"{pretty_arm(method)}, {value:g}", arm)
        for method, line in sweep.lines.items()
        for value, arm in line.items()
    ]
    rows += [
        _values_row(study, pretty_arm(method), arm) for method, arm in sweep.references.items()
    ]
    names = (f"{quantity(metric).label}" for metric in metrics_of(study))
    note = "Mean ± standard deviation over seeds of the mean over the last 20 % of training."
    return Table(f"Results by {sweep.key}", ("arm", "seeds", *names), tuple(rows), note)


def _values_row(study: Study, name: str, arm: str) -> tuple[str, ...]:
    cells = []
    for metric in metrics_of(study):
        sample, digits = end_of_training(study, metric, arm), digits_of(metric)
        spread = sample.std(ddof=1) if sample.size > 1 else np.nan
        cells.append(f"{sample.mean():.{digits}f}{NBSP}±{NBSP}{number(spread, digits)}")
    return (name, str(len(study.seeds(arm))), *cells)


def trend_table(study: Study, sweep: Sweep) -> Table:
    """Does the value matter, and does more of it mean more of the metric: a row per metric."""
    header = (
        *("metric", "method", "p, the value matters"),
        *("rank correlation with the value", "p, it grows or falls with it"),
    )
    note = (
        "Permutations of the runs: Kruskal and Wallis' H (any difference between the values) and "
        "Spearman's rank correlation (one direction), not adjusted for the number of rows. Runs "
        "of the same seed count as independent."
    )
    return Table("All values together", header, tuple(_trend_rows(study, sweep)), note)


def _trend_rows(study: Study, sweep: Sweep) -> Iterator[tuple[str, ...]]:
    for metric in metrics_of(study):
        for method, line in sweep.lines.items():
            samples = [end_of_training(study, metric, arm) for arm in line.values()]
            found = trend(list(line), samples, generator=np.random.default_rng(SEED))
            yield (
                quantity(metric).name,
                pretty_arm(method),
                p_text(found.any_difference),
                number(found.monotone.statistic, 2),
                p_text(found.monotone),
            )
