"""How hard the weight search is: share of weights at the optimum, and J before and after it."""

from matplotlib.ticker import FuncFormatter, SymmetricalLogLocator

from analysis.data.study import Study
from analysis.figures.drawing import Drawing, NotDrawnError, caption_of
from analysis.figures.lines import arm_legend, draw_arms
from analysis.figures.series import all_series, column, with_metric
from analysis.figures.style import (
    TWO_COLUMNS_IN,
    arm_looks,
    new_figure,
    panel_letter,
    styled,
)
from tlr_exp import keys

# Metric, title, axis label, factor from the metric to the axis, logarithmic above 1.
_PANELS = (
    (keys.OPTIMAL_SHARE, "Pack at the best J", "Share of the pack (%)", 100.0, False),
    (keys.BOX_OPTIMAL_SHARE, "Weight box at the best J", "Share of the box (%)", 100.0, False),
    (keys.OBJECTIVE_BEFORE, "J at the weights 1", "J (no unit)", 1.0, True),
    (keys.OBJECTIVE_AFTER, "J at the weights in use", "J (no unit)", 1.0, True),
)


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
        if logarithmic:
            axis.set_yscale("symlog", linthresh=1.0, linscale=0.5)
            axis.yaxis.set_major_locator(
                SymmetricalLogLocator(base=10, linthresh=1.0, subs=[1, 2, 5])
            )
            axis.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        # A little beyond 0 and 100 %, so that a curve that lies there is seen whole.
        if logarithmic:
            axis.set_ylim(bottom=-0.08)
        else:
            top = min(axis.get_ylim()[1], 103.0)
            axis.set_ylim(-0.03 * top, top)
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
