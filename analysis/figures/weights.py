"""The weights over training, Figure 14; and how hard the search for them is."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, SymmetricalLogLocator

from analysis.data.study import Study, pretty_arm
from analysis.figures.drawing import Drawing, NotDrawnError, caption_of
from analysis.figures.lines import arm_legend, draw_arms, iteration_axis, moving_average, shade
from analysis.figures.series import (
    Series,
    all_series,
    column,
    last_iteration,
    series_of,
    with_metric,
)
from analysis.figures.style import (
    TWO_COLUMNS_IN,
    ArmLook,
    arm_looks,
    darker,
    new_figure,
    panel_letter,
    styled,
)
from tlr_exp import keys

_COLUMNS = 3  # of the panels of one arm
_LONGEST_WINDOW_SHARE = 0.05  # of the training, for the thick line
# Metric, title, axis label, factor from the metric to the axis, logarithmic above 1.
_PANELS = (
    (keys.OPTIMAL_SHARE, "Pack at the best J", "Share of the pack (%)", 100.0, False),
    (keys.BOX_OPTIMAL_SHARE, "Weight box at the best J", "Share of the box (%)", 100.0, False),
    (keys.OBJECTIVE_BEFORE, "J at the weights 1", "J (no unit)", 1.0, True),
    (keys.OBJECTIVE_AFTER, "J at the weights in use", "J (no unit)", 1.0, True),
)


@styled
def figure_14(study: Study) -> Drawing:
    """Weight of every lower-layer term over iterations, one panel per term (and arm that adapts).

    Arms whose weights never change are left out and named in the caption.

    Raises:
        NotDrawnError: no arm has weights, or none of them changes.
    """
    terms = weight_terms(study)
    adapting = tuple(arm for arm in study.arms if _adapts(study, arm, terms))
    if not adapting:
        raise NotDrawnError("no arm changes its weights: every one keeps them over the training")
    window = smoothing_window(study)
    looks = arm_looks(study.arms)
    top = max(1.0, *(float(np.nanmax(column(study, keys.WEIGHT_PREFIX + term))) for term in terms))
    if len(adapting) == 1:
        figure = _panels_of_one_arm(study, adapting[0], terms, window, looks)
    else:
        figure = _grid_of_arms(study, adapting, terms, window, looks)
    figure.axes[0].set_ylim(-0.03 * top, 1.03 * top)  # all panels share it
    caption = _caption(study, adapting, window)
    return Drawing(figure, "Weights of the lower layer over training", caption, "figure_14_weights")


def weight_terms(study: Study) -> tuple[str, ...]:
    """Terms with a weight, in the order of the study's columns.

    Raises:
        NotDrawnError: there is none.
    """
    prefix = keys.WEIGHT_PREFIX
    terms = tuple(m.removeprefix(prefix) for m in study.metric_names if m.startswith(prefix))
    if not terms:
        raise NotDrawnError(f"the study has no metric that begins with {prefix}")
    return terms


def smoothing_window(study: Study) -> int:
    """Iterations of the moving average: odd, a twentieth of those that the longest run has."""
    return 2 * int(last_iteration(study) * _LONGEST_WINDOW_SHARE / 2) + 1


def _adapts(study: Study, arm: str, terms: tuple[str, ...]) -> bool:
    rows = study.curves.loc[study.curves["arm"] == arm, [keys.WEIGHT_PREFIX + t for t in terms]]
    return bool((rows.max() > rows.min()).any())


def _panels_of_one_arm(
    study: Study, arm: str, terms: tuple[str, ...], window: int, looks: dict[str, ArmLook]
) -> Figure:
    columns = min(_COLUMNS, len(terms))
    rows = -(-len(terms) // columns)
    figure, axes = new_figure(TWO_COLUMNS_IN, 0.5 + 1.45 * rows, rows, columns, sharey=True)
    for place, panel in enumerate(axes.flat):
        if place >= len(terms):
            panel.set_visible(False)
            continue
        bottom = place + columns >= len(terms)
        series = series_of(study, keys.WEIGHT_PREFIX + terms[place], arm)
        _draw_weight(panel, series, looks[arm], window)
        panel.set_title(f"{terms[place]}: {_numbers(series)}", loc="left", fontsize=7)
        iteration_axis(panel, last_iteration(study), label=bottom)
    figure.supylabel("Weight (no unit)", fontsize=7.5)
    return figure


def _grid_of_arms(
    study: Study,
    arms: tuple[str, ...],
    terms: tuple[str, ...],
    window: int,
    looks: dict[str, ArmLook],
) -> Figure:
    """Terms down, arms across: weights of several arms in one panel would hide each other."""
    size = (TWO_COLUMNS_IN, 0.7 + 1.05 * len(terms))
    figure, axes = new_figure(*size, len(terms), len(arms), sharey=True, sharex=True)
    for row, term in enumerate(terms):
        for place, arm in enumerate(arms):
            panel = axes[row, place]
            series = series_of(study, keys.WEIGHT_PREFIX + term, arm)
            _draw_weight(panel, series, looks[arm], window)
            title = _numbers(series)
            if row == 0:
                title = f"{_wrapped(pretty_arm(arm))}\n{title}"
            panel.set_title(title, loc="left", fontsize=6.5 if len(arms) < 4 else 5.5)
            iteration_axis(panel, last_iteration(study), label=row == len(terms) - 1)
        axes[row, 0].set_ylabel(term, fontsize=6.5)
    figure.supylabel("Weight (no unit)", fontsize=7.5)
    return figure


def _draw_weight(axes: Axes, series: Series, look: ArmLook, window: int) -> None:
    """Band and thin line of the raw values, thick line of their moving average."""
    band = series.band
    if band.num_seeds > 1:
        shade(axes, series.iterations, band.low, band.high, look, of=1)
    color = look.color
    axes.plot(series.iterations, band.mean, color=color, linewidth=0.4, alpha=0.45, zorder=2.5)
    smooth = moving_average(band.mean, window)
    axes.plot(series.iterations, smooth, color=darker(color), linewidth=1.3, zorder=3)


def _numbers(series: Series) -> str:
    mean = series.band.mean
    return f"final {mean[-1]:.2f}, mean {mean.mean():.2f}"


def _wrapped(label: str) -> str:
    return label.replace(", ", ",\n")


def _caption(study: Study, adapting: tuple[str, ...], window: int) -> str:
    still = [pretty_arm(arm) for arm in study.arms if arm not in adapting]
    left_out = f" Not shown, as its weights never change: {', '.join(still)}." if still else ""
    what = (
        "Weight of each term of the lower layer over training, without unit, for "
        f"{', '.join(pretty_arm(arm) for arm in adapting)}: mean over seeds. Numbers: mean over "
        f"seeds at the last iteration (final) and over all iterations (mean).{left_out}"
    )
    smoothing = "none"
    if window > 1:
        smoothing = (
            f"thick lines: centred moving average over {window} iterations; thin lines and "
            "bands: none"
        )
    return caption_of(study, what, band=True, smoothing=smoothing)


# --- how hard the search is ------------------------------------------------------------------
@styled
def figure_optimum(study: Study) -> Drawing:
    """Share of the pack and of the weight box at the optimum, J at weights 1 and in use.

    Panels of metrics that the study lacks are left out.

    Raises:
        NotDrawnError: the study has none of the metrics, or an arm has no value of one.
    """
    panels = [panel for panel in _PANELS if panel[0] in study.metric_names]
    if not panels:
        raise NotDrawnError(f"the study has none of {', '.join(panel[0] for panel in _PANELS)}")
    looks = arm_looks(study.arms)
    rows = -(-len(panels) // 2)
    columns = min(2, len(panels))
    figure, axes = new_figure(TWO_COLUMNS_IN, 0.3 + 1.9 * rows, rows, columns)
    for place, axis in enumerate(axes.flat):
        if place >= len(panels):
            axis.set_visible(False)
            continue
        metric, title, label, factor, logarithmic = panels[place]
        scaled = with_metric(study, metric, factor * column(study, metric))
        draw_arms(axis, all_series(scaled, metric), looks, floor=True)
        _optimum_axis(axis, logarithmic)
        axis.set_ylabel(label)
        panel_letter(axis, "abcd"[place], title)
    arm_legend(figure, list(looks.values()))
    what = (
        "The weight search over training. (a) Share of the pack that has the best J, in per cent; "
        "an arm without a search counts as a pack of one. (b) Share of a fixed sample of the "
        "weight box that has the smallest J known, in per cent; 0: nothing in the sample is as "
        "good as the weights in use. (c), (d) J of the weights 1 and of the weights in use, "
        "without unit; axis linear from 0 to 1, logarithmic above. Where many weights are equally "
        "good, J does not say which to take."
    )
    caption = caption_of(study, what, band=True)
    return Drawing(figure, "Weights at the optimum over training", caption, "weights_at_optimum")


def _optimum_axis(axis: Axes, logarithmic: bool) -> None:
    """A little beyond 0 and 100 %, so that a curve that lies there is seen whole."""
    if not logarithmic:
        top = min(axis.get_ylim()[1], 103.0)
        axis.set_ylim(-0.03 * top, top)
        return
    axis.set_yscale("symlog", linthresh=1.0, linscale=0.5)
    axis.yaxis.set_major_locator(SymmetricalLogLocator(base=10, linthresh=1.0, subs=[1, 2, 5]))
    axis.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.set_ylim(bottom=-0.08)
