"""Figures 6, 7 and 13: episode length and tracking errors over training."""

from collections.abc import Sequence

from matplotlib.figure import Figure

from analysis.data.study import Study
from analysis.figures.drawing import Drawing, caption_of
from analysis.figures.lines import arm_legend, draw_arms
from analysis.figures.series import all_series, one_run_of_each_arm
from analysis.figures.style import (
    PAPER_COLUMN_IN,
    TWO_COLUMNS_IN,
    arm_looks,
    new_figure,
    panel_letter,
    styled,
)
from analysis.measures.quantities import quantity
from tlr_exp import keys

BODY_PANELS = (
    (keys.TRAIN_UPPER_BODY_ERROR, "Upper body"),
    (keys.TRAIN_LOWER_BODY_ERROR, "Lower body"),
)
_ERROR_MEANING = (
    "the distance of each tracked body from its reference in the world frame, in metres, averaged "
    "over bodies, environments and control steps, under exploration noise and before termination"
)


@styled
def figure_6(study: Study) -> Drawing:
    """Mean episode length over iterations; the paper shows one run per arm, here all seeds.

    Raises:
        NotDrawnError: an arm has no episode length.
    """
    figure = _curves(study, [(keys.EPISODE_LENGTH, "")], PAPER_COLUMN_IN, 2.4)
    what = (
        "Length of an episode over training, in control steps of 0.02 s: mean of the last 100 "
        "finished episodes."
    )
    caption = caption_of(study, what, band=True)
    return Drawing(figure, "Episode length over training", caption, "figure_06_episode_length")


@styled
def figure_7(study: Study) -> Drawing:
    """Upper- and lower-body error over iterations, of one run per arm as in the paper.

    Raises:
        NotDrawnError: an arm has no tracking errors, or the arms share no seed.
    """
    single, seed = one_run_of_each_arm(study)
    figure = _curves(single, BODY_PANELS, TWO_COLUMNS_IN, 2.3)
    what = (
        f"Tracking error over training: {_ERROR_MEANING}. As in the paper, one run per arm: seed "
        f"{seed}, the lowest that all arms have. Figure 13 shows all seeds."
    )
    caption = caption_of(single, what, band=True)
    title = "Tracking errors over training, one run per arm"
    return Drawing(figure, title, caption, "figure_07_tracking_errors")


@styled
def figure_13(study: Study) -> Drawing:
    """Upper- and lower-body error over iterations: mean over seeds ± 1 standard deviation.

    Raises:
        NotDrawnError: an arm has no tracking errors.
    """
    figure = _curves(study, BODY_PANELS, TWO_COLUMNS_IN, 2.3)
    caption = caption_of(study, f"Tracking error over training: {_ERROR_MEANING}.", band=True)
    title = "Tracking errors over training, all seeds"
    return Drawing(figure, title, caption, "figure_13_seed_bands")


def _curves(
    study: Study, panels: Sequence[tuple[str, str]], width_in: float, height_in: float
) -> Figure:
    """One panel per metric with the mean and band of every arm."""
    figure, axes = new_figure(width_in, height_in, columns=len(panels))
    looks = arm_looks(study.arms)
    for number, (metric, title) in enumerate(panels):
        panel = axes[0, number]
        draw_arms(panel, all_series(study, metric), looks)
        panel.set_ylabel(quantity(metric).label)
        panel.set_ylim(bottom=0)
        if title:
            panel_letter(panel, "ab"[number], title)
    arm_legend(figure, list(looks.values()))
    return figure
