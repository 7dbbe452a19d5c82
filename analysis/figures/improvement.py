"""Figure 8: relative improvement of the tracking errors over the baseline."""

import numpy as np
from matplotlib.axes import Axes

from analysis.data.study import Study, pretty_arm
from analysis.figures.drawing import Drawing, NotDrawnError, caption_of
from analysis.figures.lines import arm_legend, draw_curve, iteration_axis, label_at_right
from analysis.figures.series import only_seeds, pair_of, shared_seeds
from analysis.figures.style import (
    GREY,
    MINUS,
    TWO_COLUMNS_IN,
    ArmLook,
    arm_looks,
    darker,
    new_figure,
    panel_letter,
    styled,
)
from analysis.figures.tracking import BODY_PANELS
from analysis.statistics.paper import relative_improvement


@styled
def figure_8(study: Study) -> Drawing:
    """Relative improvement of both errors over iterations, and its average over iterations.

    Raises:
        NotDrawnError: one arm alone, or an arm without tracking errors.
    """
    compared = compared_arms(study)
    looks = arm_looks(study.arms)
    figure, axes = new_figure(TWO_COLUMNS_IN, 2.3, columns=len(BODY_PANELS))
    averages = []
    for number, (metric, title) in enumerate(BODY_PANELS):
        curves = {arm: improvement(study, metric, arm) for arm in compared}
        means = {arm: float(values.mean()) for arm, (_, values) in curves.items()}
        _draw_panel(axes[0, number], curves, means, looks)
        panel_letter(axes[0, number], "ab"[number], title)
        averages += [
            f"{title.lower()}, {pretty_arm(arm)}: {percent(mean)}{_of_one_run(study, metric, arm)}"
            for arm, mean in means.items()
        ]
    axes[0, 0].set_ylabel(f"Improvement over {pretty_arm(study.baseline)} (%)")
    arm_legend(figure, [looks[arm] for arm in compared])
    what = (
        f"Relative improvement of the tracking error over {pretty_arm(study.baseline)}, "
        "(e_baseline - e_arm) / e_baseline of the seed-averaged curves, in per cent; positive: the "
        "arm tracks better. Horizontal lines and numbers at the right: average over iterations "
        f"({'; '.join(averages) if len(compared) < 3 else 'of every arm'})."
    )
    caption = caption_of(study, what, band=False)
    return Drawing(figure, "Relative improvement over training", caption, "figure_08_improvement")


def compared_arms(study: Study) -> tuple[str, ...]:
    """The arms that are compared with the baseline.

    Raises:
        NotDrawnError: there is none.
    """
    if len(study.arms) < 2:
        raise NotDrawnError(f"there is one arm alone, {study.baseline!r}: nothing to compare")
    return study.arms[1:]


def improvement(study: Study, metric: str, arm: str) -> tuple[np.ndarray, np.ndarray]:
    """Iterations [T] and relative improvement [T] (a share) of the seed-averaged error of an arm.

    Raises:
        NotDrawnError: the metric is missing, or an averaged error of the baseline is not positive.
    """
    baseline, other = pair_of(study, metric, arm)
    try:
        values = relative_improvement(baseline.band.mean, other.band.mean)
    except ValueError as error:
        raise NotDrawnError(f"{metric}: {error}") from error
    return baseline.iterations, values


def percent(share: float) -> str:
    """A share with its sign: 0.0425 -> "+4.3 %"."""
    return f"{100 * share:+.1f} %".replace("-", MINUS)


def _of_one_run(study: Study, metric: str, arm: str) -> str:
    """The average of the one run per arm that Figure 7 shows, where there are more runs."""
    shared = shared_seeds(study)
    if not shared or len(study.seeds(arm)) == len(study.seeds(study.baseline)) == 1:
        return ""
    _, values = improvement(only_seeds(study, shared[:1]), metric, arm)
    return f" (seed {shared[0]} alone: {percent(float(values.mean()))})"


def _draw_panel(
    axes: Axes,
    curves: dict[str, tuple[np.ndarray, np.ndarray]],
    means: dict[str, float],
    looks: dict[str, ArmLook],
) -> None:
    axes.axhline(0, color=GREY, linewidth=0.8, zorder=1.5)
    for place, (arm, (iterations, values)) in enumerate(curves.items()):
        line = draw_curve(axes, iterations, 100 * values, looks[arm], place, len(curves))
        line.set_linewidth(0.9)
        axes.axhline(100 * means[arm], color=looks[arm].color, linewidth=1.0, linestyle=(0, (6, 3)))
    iteration_axis(axes, max(iterations[-1] for iterations, _ in curves.values()))
    label_at_right(
        axes,
        [100 * mean for mean in means.values()],
        [percent(mean) for mean in means.values()],
        [darker(looks[arm].color) for arm in means],
    )
