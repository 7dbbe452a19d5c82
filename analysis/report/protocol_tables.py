"""Tables of the analysis that the paper may have made, and of what its p-values rest on."""

from collections.abc import Mapping

from analysis.measures.quantities import quantity
from analysis.report.cells import NBSP, Table, number, p_text, p_value_text
from analysis.report.evidence import BODIES, Evidence
from analysis.statistics.nulls import EXTREME_P, FalsePositiveRates
from analysis.statistics.significance import paired_t
from analysis.statistics.units import needed_effect, over_stretches
from tlr_exp import keys

PAPER_P = {keys.TRAIN_UPPER_BODY_ERROR: 1.72e-9, keys.TRAIN_LOWER_BODY_ERROR: 6.00e-13}
STRETCHES = (5, 10, 15, 20, 50, 100, 500)


def protocol_table(evidence: Evidence) -> Table:
    """The t-test over iterations, with what its p-value rests on."""
    rows = []
    for metric in BODIES:
        found = evidence.paper_protocol(metric)
        rest = found.dependence
        rows.append(
            (
                quantity(metric).name,
                f"{100 * found.average_improvement:+.2f}{NBSP}%",
                p_text(found.iteration_test),
                str(rest.num_iterations),
                number(rest.lag_one, 3),
                number(rest.effective_sample_size, 1),
            )
        )
    header = (
        *("error", "average relative improvement", "p, paired t over iterations"),
        *("iterations", "autocorrelation of neighbours", "worth as independent iterations"),
    )
    note = (
        "Curves averaged over seeds, then a t-test whose pairs are iterations. The paper names no "
        "test: that it made this one is a conjecture. Its p-value says nothing about seeds: it "
        "asks whether these averaged curves differ on average, which the curves of any two groups "
        "of seeds do, and it takes neighbouring iterations for independent, which they are not."
    )
    return Table(f"The analysis over iterations: {evidence.versus}", header, tuple(rows), note)


def units_table(evidence: Evidence) -> Table:
    """Which pairs would give the paper's p-values: what they need, and what they give here."""
    curves = {metric: evidence.curves(metric) for metric in BODIES}
    rows = [_seeds_row(evidence, curves)] if evidence.paired else []
    length = curves[BODIES[0]][0].shape[1]
    counts = [count for count in STRETCHES if count < length] + [length]
    found = {
        metric: over_stretches(first.mean(axis=0), second.mean(axis=0), counts)
        for metric, (first, second) in curves.items()
    }
    for upper, lower in zip(*found.values(), strict=True):
        alone = upper.count == length
        each = f"{length / upper.count:.3g}"
        name = "iterations" if alone else f"stretches of about {each} iterations"
        rows.append(_units_row(name, upper.count, p_text(upper.test), p_text(lower.test)))
    header = (
        *("pairs", "how many"),
        *(f"{_body(metric)}: needed for the paper's {PAPER_P[metric]:.3g}" for metric in BODIES),
        *(f"{_body(metric)}: p here" for metric in BODIES),
    )
    note = (
        "Needed: how many of their standard deviations the differences of the pairs must lie from "
        "0, on average, for a paired t to give the paper's p. Five seeds would need what no "
        "experiment has. p here: the same test on this study's curves, averaged over seeds and "
        "then over stretches of training; it falls as the same curves are cut into more pairs, "
        "whatever the seeds say."
    )
    return Table(f"Which pairs give such p-values: {evidence.versus}", header, tuple(rows), note)


def _seeds_row(evidence: Evidence, curves: Mapping[str, tuple]) -> tuple[str, ...]:
    tests = [paired_t(first.mean(axis=1), second.mean(axis=1)) for first, second in curves.values()]
    count = len(evidence.study.seeds(evidence.baseline))
    return _units_row("seeds, mean over training", count, *map(p_text, tests))


def _units_row(name: str, count: int, *p_here: str) -> tuple[str, ...]:
    needed = (
        number(needed_effect(p, count), 2) if count > 1 else p_value_text(float("nan"))
        for p in PAPER_P.values()
    )
    return (name, str(count), *needed, *p_here)


def _body(metric: str) -> str:
    return quantity(metric).name.removesuffix(" error")


def false_positive_table(rates: Mapping[str, FalsePositiveRates]) -> Table:
    """How often each protocol calls nothing something, for each of the metrics."""
    of_any = next(iter(rates.values()))
    kinds = (
        ("paired t over iterations", lambda each: each.iteration_t),
        (f"the same, p below {EXTREME_P:.0e}", lambda each: each.iteration_t_extreme),
        ("Welch t over seeds", lambda each: each.welch),
        ("permutation of seeds", lambda each: each.permutation),
    )
    rows = tuple(
        (name, *(f"{100 * share(each):.1f}{NBSP}%" for each in rates.values()))
        for name, share in kinds
    )
    note = (
        f"{of_any.num_studies} simulated studies a column without any difference between the arms, "
        f"{of_any.num_seeds[0]} seeds each and {of_any.num_iterations} iterations, with the "
        "autocorrelation and the spread between seeds of this study's curves of that error. A "
        f"sound test calls {100 * of_any.alpha:.0f} % of them significant at {of_any.alpha:g}, or "
        "fewer."
    )
    header = (f"test at {of_any.alpha:g}", *(f"{quantity(m).name}: called" for m in rates))
    return Table("False alarms under a true null", header, rows, note)
