"""Forest plot: what the seeds say of the difference of each metric, with intervals."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes

from analysis.data.study import Study
from analysis.figures.curve_comparison import DRAW_SEED
from analysis.figures.drawing import Drawing, NotDrawnError, caption_of
from analysis.figures.improvement import compared_arms
from analysis.figures.lines import arm_legend
from analysis.figures.series import pair_of
from analysis.figures.style import (
    GREY,
    MINUS,
    TWO_COLUMNS_IN,
    ArmLook,
    arm_looks,
    new_figure,
    styled,
)
from analysis.measures.endpoints import final_value, tail_mean
from analysis.measures.quantities import QUANTITIES, quantity
from analysis.statistics.comparison import Comparison, compare
from analysis.statistics.results import Interval
from tlr_exp import keys


@dataclass(frozen=True)
class ForestRow:
    """One comparison: what was measured (name and unit), in which arm, and what came out."""

    name: str
    unit: str
    arm: str
    comparison: Comparison


@styled
def figure_forest(study: Study) -> Drawing:
    """The main metrics at their endpoints, every arm against the baseline, independent seeds.

    Raises:
        NotDrawnError: one arm alone, or none of the metrics.
    """
    rows = [row for arm in compared_arms(study) for row in _rows_of(study, arm)]
    return forest_plot(rows, study)


@styled
def forest_plot(rows: Sequence[ForestRow], study: Study) -> Drawing:
    """Relative improvement with its interval, one line per row, and the difference in its unit.

    Rows of the same name and unit share a line of the plot, one marker per arm.

    Raises:
        NotDrawnError: no row has a relative improvement.
    """
    drawable = [row for row in rows if np.isfinite(row.comparison.relative_improvement.estimate)]
    if not drawable:
        raise NotDrawnError("no metric has a relative improvement over the baseline")
    looks = arm_looks(study.arms)
    arms = [arm for arm in study.arms if any(row.arm == arm for row in drawable)]
    names = list(dict.fromkeys((row.name, row.unit) for row in drawable))
    slot = max(0.3, 0.17 * len(arms) + 0.08)
    figure, axes = new_figure(TWO_COLUMNS_IN, 0.85 + slot * len(names))
    panel = axes[0, 0]
    for row in drawable:
        inner = (arms.index(row.arm) + 0.5) / len(arms) - 0.5
        height = names.index((row.name, row.unit)) + 0.8 * inner
        _draw_row(panel, height, row.comparison, looks[row.arm])
        _write_row(panel, height, row, small=len(arms) > 2)
    panel.axvline(0, color=GREY, linewidth=0.8, zorder=1.5)
    panel.set_yticks(range(len(names)), [name for name, _ in names])
    panel.set_ylim(len(names) - 0.5, -0.5)
    panel.tick_params(axis="y", length=0)
    panel.grid(visible=False, axis="y")
    panel.set_xlabel("Relative improvement over the baseline (%); right of 0: better")
    arm_legend(figure, [looks[arm] for arm in arms])
    caption = caption_of(study, _what(drawable), band=False)
    return Drawing(figure, "Differences with the seed as the unit", caption, "forest")


def _rows_of(study: Study, arm: str) -> list[ForestRow]:
    rows = []
    for metric in QUANTITIES:
        measure = final_value if metric.startswith(keys.EVAL_PREFIX) else tail_mean
        try:
            pair = pair_of(study, metric, arm)
        except NotDrawnError:
            continue  # a metric that was not recorded is no row
        scores = [measure(series.values, series.iterations) for series in pair]
        shown = quantity(metric)
        comparison = compare(
            *scores,
            smaller_is_better=not shown.larger_is_better,
            generator=np.random.default_rng(DRAW_SEED),
        )
        rows.append(ForestRow(shown.name, shown.unit, arm, comparison))
    return rows


def _draw_row(axes: Axes, height: float, comparison: Comparison, look: ArmLook) -> None:
    interval = comparison.relative_improvement
    if np.isfinite(interval.low):
        ends = [100 * interval.low, 100 * interval.high]
        axes.plot(ends, [height, height], color=look.color, linewidth=1.3, solid_capstyle="butt")
        axes.plot(ends, [height, height], "|", color=look.color, markersize=5, markeredgewidth=1.0)
    axes.plot(100 * interval.estimate, height, look.marker, color=look.color, markersize=5)


def _write_row(axes: Axes, height: float, row: ForestRow, small: bool) -> None:
    """The difference in units of the metric, at the right of the panel."""
    text = f"{_interval_text(row.comparison.difference)} {_short(row.unit)}".rstrip()
    p_value = row.comparison.permutation_test.p_value
    if np.isfinite(p_value):
        text += f", p = {p_value:.2g}"
    axes.text(
        1.015,
        height,
        text,
        va="center",
        fontsize=5.5 if small else 6.5,
        transform=axes.get_yaxis_transform(),
    )


def _interval_text(interval: Interval) -> str:
    """Estimate and limits with as many decimals as the width of the interval is worth."""
    width = interval.high - interval.low
    if not np.isfinite(width) or width <= 0:
        return f"{interval.estimate:+.3g}".replace("-", MINUS)
    decimals = max(0, 2 - int(np.floor(np.log10(width))))
    estimate, low, high = (
        f"{value:+.{decimals}f}" for value in (interval.estimate, interval.low, interval.high)
    )
    return f"{estimate} [{low}, {high}]".replace("-", MINUS)


def _short(unit: str) -> str:
    short = {"control steps": "steps", "share of roll-out": "", "share of roll-outs": ""}
    return short.get(unit, unit)


def _what(rows: Sequence[ForestRow]) -> str:
    interval = rows[0].comparison.relative_improvement
    difference = rows[0].comparison.difference
    first = rows[0].comparison
    text = (
        "Relative improvement of the mean over seeds against the baseline, in per cent, with its "
        f"{100 * interval.confidence:.0f} % confidence interval ({interval.method}). At the right: "
        "difference, arm less baseline, in the unit of the metric with its interval "
        f"({difference.method}) and the p-value of the permutation test of seeds, not corrected "
        f"for the number of metrics; so many seeds cannot give a p below {first.smallest_p:.2g}. "
        "Metrics of the training: mean over the last 20 % of the iterations; of the evaluation: "
        "the last one."
    )
    if not any(np.isfinite(row.comparison.relative_improvement.low) for row in rows):
        text += f" No intervals: {interval.reason}."
    return text
