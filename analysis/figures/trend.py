"""A swept number against what comes of it: the curve over a sweep such as ``threshold``."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import FixedLocator, FuncFormatter, NullLocator

from analysis.data.study import Study
from analysis.figures.drawing import Drawing, NotDrawnError, caption_of
from analysis.figures.lines import BAND_ALPHA, arm_legend
from analysis.figures.series import series_of
from analysis.figures.style import (
    TWO_COLUMNS_IN,
    ArmLook,
    arm_looks,
    new_figure,
    panel_letter,
    styled,
)
from analysis.figures.tracking import BODY_PANELS
from analysis.measures.endpoints import tail_mean
from analysis.measures.quantities import quantity
from analysis.measures.swept import Sweep, sweep_of
from analysis.statistics.intervals import mean_interval
from tlr_exp import keys

PANELS = (*BODY_PANELS, (keys.EPISODE_LENGTH, "Episode length"))
_LOGARITHMIC_FROM = 10  # largest value over the smallest
_SHIFT = 0.01  # of the axis: seeds and intervals of several methods side by side


@styled
def figure_trend(study: Study) -> Drawing:
    """Errors and episode length over a swept number, a line per method, all seeds.

    Raises:
        NotDrawnError: the arms do not differ in one number, or an arm lacks a metric.
    """
    sweep = sweep_of(study)
    if sweep is None:
        raise NotDrawnError("the arms do not differ in one number")
    looks = arm_looks([*sweep.references, *sweep.lines])
    figure, axes = new_figure(TWO_COLUMNS_IN, 2.5, columns=len(PANELS))
    for number, (metric, title) in enumerate(PANELS):
        panel = axes[0, number]
        for method, arm in sweep.references.items():
            _draw_reference(panel, _results(study, metric, arm), looks[method])
        for place, (method, line) in enumerate(sweep.lines.items()):
            found = {value: _results(study, metric, arm) for value, arm in line.items()}
            _draw_line(panel, found, looks[method], place - (len(sweep.lines) - 1) / 2)
        _value_axis(panel, sweep.values)
        panel.set_ylim(bottom=0)
        panel.set_ylabel(quantity(metric).label)
        panel_letter(panel, "abc"[number], title)
    axes[0, 1].set_xlabel(sweep.key)
    arm_legend(figure, list(looks.values()))
    caption = caption_of(study, _what(sweep), band=False)
    return Drawing(figure, f"What comes of {sweep.key}", caption, "trend")


def _results(study: Study, metric: str, arm: str) -> np.ndarray:
    series = series_of(study, metric, arm)
    return tail_mean(series.values, series.iterations)


def _what(sweep: Sweep) -> str:
    text = (
        f"Each metric of training, mean over the last 20 % of the iterations, at every value of "
        f"{sweep.key}. Small dots: runs; line: mean over seeds; whiskers: 95 % interval of the "
        "mean (Student t), not corrected for the number of values."
    )
    if sweep.references:
        text += " Horizontal: arms that do not have the setting or only one value of it."
    return text


def _draw_line(axes: Axes, found: dict[float, np.ndarray], look: ArmLook, place: float) -> None:
    """Dots, means and intervals of one method; its places are shifted beside those of others."""
    at = np.array(list(found))
    shift = place * _SHIFT
    at = at * (1 + 5 * shift) if _is_wide(at) else at + shift * np.ptp(at)
    intervals = [mean_interval(sample) for sample in found.values()]
    means = [interval.estimate for interval in intervals]
    for x, sample, interval in zip(at, found.values(), intervals, strict=True):
        runs = [x] * sample.size
        axes.plot(runs, sample, ".", color=look.color, alpha=0.55, markersize=3, zorder=2.5)
        axes.plot([x, x], [interval.low, interval.high], color=look.color, linewidth=0.9)
    axes.plot(at, means, **look.line, zorder=3)


def _draw_reference(axes: Axes, sample: np.ndarray, look: ArmLook) -> None:
    interval = mean_interval(sample)
    axes.axhline(interval.estimate, color=look.color, linestyle=look.linestyle, linewidth=1.0)
    if np.isfinite(interval.low):
        axes.axhspan(interval.low, interval.high, color=look.color, alpha=BAND_ALPHA, linewidth=0)


def _value_axis(axes: Axes, values: tuple[float, ...]) -> None:
    """Horizontal axis with the swept values as its ticks, logarithmic where they span decades."""
    if _is_wide(np.array(values)):
        axes.set_xscale("log")
    axes.xaxis.set_major_locator(FixedLocator(list(values)))
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.xaxis.set_minor_locator(NullLocator())


def _is_wide(values: np.ndarray) -> bool:
    return bool(values.min() > 0 and values.max() / values.min() >= _LOGARITHMIC_FROM)
