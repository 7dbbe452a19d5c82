"""Every run as a line of its own, and how the seeds are distributed at the end."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator, MultipleLocator

from analysis.data.study import Study
from analysis.figures.drawing import Drawing, NotDrawnError, caption_of
from analysis.figures.lines import arm_legend, draw_curve, iteration_axis
from analysis.figures.series import all_series, last_iteration, only_seeds, series_of
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
from analysis.measures.quantities import TRAINING, quantity

_MOST_COLUMNS = 5


@styled
def figure_seeds(study: Study) -> Drawing:
    """Both tracking errors of every run: one column of panels per seed, all arms in each.

    Raises:
        NotDrawnError: there is one seed alone, or no tracking error.
    """
    seeds = sorted({seed for arm in study.arms for seed in study.seeds(arm)})
    if len(seeds) < 2:
        raise NotDrawnError("there is one seed alone: Figure 7 shows every run")
    looks = arm_looks(study.arms)
    columns = min(_MOST_COLUMNS, len(seeds))
    lines = -(-len(seeds) // columns)  # rows of panels per metric
    rows = lines * len(BODY_PANELS)
    figure, axes = new_figure(TWO_COLUMNS_IN, 0.5 + 1.25 * rows, rows, columns, sharex=True)
    for number, (metric, title) in enumerate(BODY_PANELS):
        panels = axes[number * lines : (number + 1) * lines]
        for place, panel in enumerate(panels.flat):
            panel.sharey(panels[0, 0])
            if place >= len(seeds):
                panel.set_visible(False)
                continue
            _draw_seed(panel, only_seeds(study, (seeds[place],)), metric, looks)
            iteration_axis(panel, last_iteration(study), label=False)
            panel.set_title(f"{title}, seed {seeds[place]}", loc="left", fontsize=6.5)
            panel.label_outer()
        panels[0, 0].set_ylim(bottom=0)
        for panel in panels[:, 0]:
            panel.set_ylabel("Error (m)")
    figure.supxlabel("PPO iteration", fontsize=7.5)
    arm_legend(figure, list(looks.values()))
    what = "Tracking error of every single run over training, in metres, by seed."
    caption = caption_of(study, what, band=False)
    return Drawing(figure, "Tracking errors of every run", caption, "seed_lines")


def _draw_seed(axes: Axes, study: Study, metric: str, looks: dict[str, ArmLook]) -> None:
    for place, arm in enumerate(study.arms):
        series = series_of(study, metric, arm)
        line = draw_curve(
            axes, series.iterations, series.values[0], looks[arm], place, len(study.arms)
        )
        line.set_linewidth(0.9)


@styled
def figure_profile(study: Study) -> Drawing:
    """Performance profile: share of seeds that are at least as good as x at the end of training.

    Raises:
        NotDrawnError: one seed alone in every arm, or a metric is missing.
    """
    if all(len(study.seeds(arm)) < 2 for arm in study.arms):
        raise NotDrawnError("one seed per arm has no distribution")
    looks = arm_looks(study.arms)
    figure, axes = new_figure(TWO_COLUMNS_IN, 2.2, columns=len(TRAINING), sharey=True)
    for number, metric in enumerate(TRAINING):
        panel, shown = axes[0, number], quantity(metric)
        scores = {
            arm: tail_mean(series.values, series.iterations)
            for arm, series in all_series(study, metric).items()
        }
        _draw_profile(panel, scores, looks, shown.larger_is_better)
        panel.xaxis.set_major_locator(MaxNLocator(nbins=4))
        panel.yaxis.set_major_locator(MultipleLocator(0.2))
        panel_letter(panel, "abc"[number], shown.name)
        sign = "≥" if shown.larger_is_better else "≤"
        panel.set_xlabel(f"x ({shown.unit}): {shown.name.lower()} {sign} x", fontsize=7)
    axes[0, 0].set_ylabel("Share of seeds")
    arm_legend(figure, list(looks.values()))
    what = (
        "Performance profile: share of an arm's seeds whose mean over the last 20 % of the "
        "iterations is x or better (errors in metres: at most x; episode length in control steps: "
        "at least x). A curve further to the left for errors, to the right for episode length, is "
        "better; curves that cross order the arms differently at different x."
    )
    caption = caption_of(study, what, band=False)
    return Drawing(figure, "Performance profiles over seeds", caption, "performance_profile")


def profile(scores: np.ndarray, larger_is_better: bool) -> tuple[np.ndarray, np.ndarray]:
    """Corners of a performance profile: scores [n] ascending, and the share [n] that reaches each.

    The share of scores <= x if smaller is better, else of scores >= x.
    """
    ascending = np.sort(scores)
    side = "left" if larger_is_better else "right"
    below = np.searchsorted(ascending, ascending, side=side)
    reached = len(scores) - below if larger_is_better else below
    return ascending, reached / len(scores)


def _draw_profile(
    axes: Axes, scores: dict[str, np.ndarray], looks: dict[str, ArmLook], larger_is_better: bool
) -> None:
    everything = np.concatenate(list(scores.values()))
    margin = 0.06 * float(np.ptp(everything)) or 0.01 * abs(float(everything[0])) or 1.0
    low, high = everything.min() - margin, everything.max() + margin
    for arm, values in scores.items():
        at, share = profile(values, larger_is_better)
        ends = (share[0], 0.0) if larger_is_better else (0.0, share[-1])
        x = np.concatenate([[low], at, [high]])
        y = np.concatenate([[ends[0]], share, [ends[1]]])
        axes.plot(
            x,
            y,
            drawstyle="steps-pre" if larger_is_better else "steps-post",
            markevery=slice(1, -1),
            **looks[arm].line,
        )
    axes.set_xlim(low, high)
    axes.set_ylim(-0.04, 1.06)
