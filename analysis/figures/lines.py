"""Curves over iterations, as all figures of a training draw them."""

from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, NullFormatter

from analysis.figures.series import Series
from analysis.figures.style import ArmLook, legend_above

ITERATION_LABEL = "PPO iteration"
BAND_ALPHA = 0.18
_LARGEST_POLYGON = 1000  # points
_MARKERS = 7  # on one curve: enough to follow it in greyscale


def mark_places(length: int, place: int, of: int) -> tuple[int, int]:
    """(first, step) of the markers of curve number ``place`` of ``of``: shifted, not on top."""
    step = max(1, length // _MARKERS)
    return (step * (place + 1)) // (of + 1), step


def draw_curve(
    axes: Axes, iterations: np.ndarray, values: np.ndarray, look: ArmLook, place: int, of: int
) -> Line2D:
    """One line [T] with the markers of its arm."""
    marks = mark_places(len(iterations), place, of)
    (line,) = axes.plot(iterations, values, markevery=marks, **look.line)
    line.set_zorder(3 + place * 0.01)
    return line


def draw_mean_and_band(
    axes: Axes, series: Series, look: ArmLook, place: int, of: int, floor: bool = False
) -> Line2D:
    """Mean over seeds with a band of ± 1 standard deviation; a line alone for one seed.

    ``floor``: the band ends at the smallest value of any seed, for quantities that cannot be
    negative and are drawn on a logarithmic axis.
    """
    band = series.band
    if band.num_seeds > 1:
        low = np.maximum(band.low, series.values.min(axis=0)) if floor else band.low
        shade(axes, series.iterations, low, band.high, look, of)
    return draw_curve(axes, series.iterations, band.mean, look, place, of)


def draw_arms(
    axes: Axes, series: Mapping[str, Series], looks: Mapping[str, ArmLook], floor: bool = False
) -> None:
    """``draw_mean_and_band`` of every arm, over all iterations that any of them has."""
    for place, (arm, one) in enumerate(series.items()):
        draw_mean_and_band(axes, one, looks[arm], place, len(series), floor)
    iteration_axis(axes, max(one.iterations[-1] for one in series.values()))


def plain_log_axis(axes: Axes) -> None:
    """Vertical logarithmic axis with numbers as people write them: 0.02, not 2 x 10^-2."""
    axes.set_yscale("log")
    low, high = axes.get_ylim()
    decades = np.log10(high / low)
    subs = (1.0, 2.0, 5.0) if decades < 2.5 else (1.0,)
    axes.yaxis.set_major_locator(LogLocator(subs=subs, numticks=12))
    axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.yaxis.set_minor_formatter(NullFormatter())


def shade(
    axes: Axes, iterations: np.ndarray, low: np.ndarray, high: np.ndarray, look: ArmLook, of: int
) -> None:
    """A band [T] in the colour of its arm, paler where many arms overlap."""
    alpha = BAND_ALPHA if of <= 3 else BAND_ALPHA / 2
    axes.fill_between(
        iterations,
        low,
        high,
        color=look.color,
        alpha=alpha,
        linewidth=0,
        zorder=2,
        # As a polygon, a band of thousands of points would be most of the file.
        rasterized=len(iterations) > _LARGEST_POLYGON,
    )


def iteration_axis(axes: Axes, last: int, label: bool = True) -> None:
    """Horizontal axis from 0 to the last iteration, whole numbers."""
    axes.set_xlim(0, max(last, 1) * 1.01)
    axes.xaxis.set_major_locator(MaxNLocator(nbins=5, integer=True))
    if label:
        axes.set_xlabel(ITERATION_LABEL)


def arm_legend(figure: Figure, looks: Sequence[ArmLook]) -> None:
    """The arms above all panels; nothing for a single arm."""
    legend_above(figure, [Line2D([], [], **look.line) for look in looks])


def label_at_right(
    axes: Axes, heights: Sequence[float], texts: Sequence[str], colors: Sequence[str]
) -> None:
    """Texts at the right edge, each at the height (data units) of what it names, none on another.

    Call it when the vertical limits are final.
    """
    low, high = axes.get_ylim()
    wanted = [(height - low) / (high - low) for height in heights]
    gap = 0.11 * 1.4 / _axes_height_in(axes)
    for place, text, color in zip(spread(wanted, gap), texts, colors, strict=True):
        axes.text(1.02, place, text, color=color, va="center", transform=axes.transAxes)


def spread(wanted: Sequence[float], gap: float) -> list[float]:
    """Places at least ``gap`` apart, in the order of those wanted and near them.

    Neighbours that are too close form a group, spaced by ``gap`` around the mean of its wishes.
    """
    order = sorted(range(len(wanted)), key=lambda index: wanted[index])
    groups: list[list[int]] = []
    for index in order:
        groups.append([index])
        while (
            len(groups) > 1
            and _first(groups[-1], wanted, gap) < _last(groups[-2], wanted, gap) + gap
        ):
            groups[-2:] = [groups[-2] + groups[-1]]
    places = [0.0] * len(wanted)
    for group in groups:
        for number, index in enumerate(group):
            places[index] = _first(group, wanted, gap) + number * gap
    return places


def _first(group: list[int], wanted: Sequence[float], gap: float) -> float:
    return sum(wanted[index] for index in group) / len(group) - gap * (len(group) - 1) / 2


def _last(group: list[int], wanted: Sequence[float], gap: float) -> float:
    return _first(group, wanted, gap) + gap * (len(group) - 1)


def _axes_height_in(axes: Axes) -> float:
    return axes.get_window_extent().height / axes.figure.dpi


def moving_average(values: np.ndarray, window: int) -> np.ndarray:
    """Moving average of [T], centred if the window is odd; shorter windows at both ends."""
    return pd.Series(values).rolling(window, center=True, min_periods=1).mean().to_numpy()
