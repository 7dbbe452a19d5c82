"""Whole curves of two arms: where they differ beyond chance, and how few values they are worth."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from analysis.data.study import Study, pretty_arm
from analysis.figures.drawing import Drawing, NotDrawnError, caption_of
from analysis.figures.improvement import compared_arms
from analysis.figures.lines import arm_legend, draw_curve, iteration_axis
from analysis.figures.series import last_iteration, pair_of
from analysis.figures.style import (
    GREY,
    SKY_BLUE,
    TWO_COLUMNS_IN,
    ArmLook,
    arm_looks,
    legend_above,
    new_figure,
    panel_letter,
    styled,
)
from analysis.figures.tracking import BODY_PANELS
from analysis.statistics.autocorrelation import autocorrelation
from analysis.statistics.curves import CurveComparison, compare_curves
from analysis.statistics.paper import dependence

DRAW_SEED = 0  # of the labelings drawn where there are too many to take all
_SHOWN_LAGS = 0.5  # of the iterations; at larger lags too few pairs are left


# --- the permutation band --------------------------------------------------------------------


@styled
def figure_curve_comparison(study: Study) -> Drawing:
    """Difference of the averaged curves, and the band that chance alone stays within.

    One row of panels per arm that is compared with the baseline.

    Raises:
        NotDrawnError: one arm alone, an arm with a single seed, or no tracking errors.
    """
    compared = compared_arms(study)
    single = [pretty_arm(arm) for arm in study.arms if len(study.seeds(arm)) < 2]
    if single:
        raise NotDrawnError(
            f"labels of seeds cannot be permuted with one seed: {', '.join(single)}"
        )
    looks = arm_looks(study.arms)
    figure, axes = new_figure(
        TWO_COLUMNS_IN, 0.5 + 1.75 * len(compared), len(compared), len(BODY_PANELS), sharex=True
    )
    found = []
    for row, arm in enumerate(compared):
        for column, (metric, title) in enumerate(BODY_PANELS):
            panel = axes[row, column]
            pair = pair_of(study, metric, arm)
            generator = np.random.default_rng(DRAW_SEED)
            result = compare_curves(pair[0].values, pair[1].values, generator=generator)
            _draw_difference(panel, pair[0].iterations, result, looks[arm])
            panel.set_title(f"{title}: p = {result.p_value:.2g}", loc="left", fontsize=7)
            iteration_axis(panel, last_iteration(study), label=row == len(compared) - 1)
            found.append(result)
        name = pretty_arm(arm).replace(", ", ",\n")
        whose = f"{name}\n" if len(compared) > 1 else ""
        axes[row, 0].set_ylabel(f"{whose}Difference (m)", fontsize=6.5 if whose else None)
    _difference_legend(axes[0, 0].figure, [looks[arm] for arm in compared])
    caption = caption_of(study, _difference_text(study, found), band=False)
    return Drawing(figure, "Whole curves compared", caption, "curve_comparison")


def _draw_difference(
    axes: Axes, iterations: np.ndarray, result: CurveComparison, look: ArmLook
) -> None:
    axes.fill_between(
        iterations, -result.margin, result.margin, color=GREY, alpha=0.2, linewidth=0, zorder=1.5
    )
    axes.axhline(0, color=GREY, linewidth=0.8, zorder=1.6)
    draw_curve(axes, iterations, result.difference, look, 0, 1)
    for first, last in runs_of(result.differs):
        axes.axvspan(
            iterations[first] - 0.5, iterations[last] + 0.5, color=SKY_BLUE, alpha=0.35, linewidth=0
        )


def runs_of(flags: np.ndarray) -> list[tuple[int, int]]:
    """First and last index of every run of true values in flags [T]."""
    padded = np.concatenate([[False], flags, [False]]).astype(np.int8)
    change = np.diff(padded)
    starts, ends = np.flatnonzero(change == 1), np.flatnonzero(change == -1) - 1
    return [(int(first), int(last)) for first, last in zip(starts, ends, strict=True)]


def _difference_legend(figure, looks: Sequence[ArmLook]) -> None:
    handles: list[Line2D | Patch] = [Line2D([], [], **look.line) for look in looks]
    handles.append(Patch(facecolor=GREY, alpha=0.2, label="within chance"))
    handles.append(Patch(facecolor=SKY_BLUE, alpha=0.35, label="differs"))
    legend_above(figure, handles)


def _difference_text(study: Study, found: Sequence[CurveComparison]) -> str:
    alpha = found[0].alpha
    labelings = "all" if found[0].exact else "drawn"
    text = (
        f"Difference of the seed-averaged tracking error, arm less {pretty_arm(study.baseline)}, "
        "in metres; below 0 the arm tracks better. Grey: the largest difference that a "
        f"permutation of the labels of the seeds makes in {100 * (1 - alpha):.0f} % of the cases "
        f"anywhere on the curve (maximum statistic of Welch's t over all iterations, {labelings} "
        f"{found[0].num_labelings} labelings). Blue: iterations where the difference exceeds it. "
        "p: of the whole curve."
    )
    smallest = max(result.smallest_p for result in found)
    if smallest > alpha:
        text += (
            f" So few seeds cannot give a p below {smallest:.2g}, so nothing can exceed the band."
        )
    return text


# --- dependence between iterations -----------------------------------------------------------


@styled
def figure_autocorrelation(study: Study) -> Drawing:
    """Autocorrelation of the difference of the averaged curves, and its effective sample size.

    Raises:
        NotDrawnError: one arm alone, no tracking errors, or a difference that never changes.
    """
    compared = compared_arms(study)
    looks = arm_looks(study.arms)
    figure, axes = new_figure(TWO_COLUMNS_IN, 2.3, columns=len(BODY_PANELS), sharey=True)
    sizes = []
    for number, (metric, title) in enumerate(BODY_PANELS):
        panel = axes[0, number]
        for place, arm in enumerate(compared):
            first, second = pair_of(study, metric, arm)
            difference = second.band.mean - first.band.mean
            worth = _draw_correlation(panel, difference, looks[arm], place, len(compared))
            sizes.append(f"{title.lower()}, {pretty_arm(arm)}: {worth}")
        panel_letter(panel, "ab"[number], title)
        panel.set_xlabel("Lag (iterations)")
    axes[0, 0].set_ylim(top=1.05)
    axes[0, 0].set_ylabel("Autocorrelation (no unit)")
    arm_legend(figure, [looks[arm] for arm in compared])
    what = (
        "Autocorrelation of the difference of the seed-averaged tracking error from "
        f"{pretty_arm(study.baseline)}, over the lag in iterations; grey: ± 1.96 / √T, where 95 % "
        "of the values of independent iterations would lie. A t-test over iterations takes every "
        "one as independent; the mean of the difference is known only as well as from the "
        f"effective sample size: {'; '.join(sizes)}."
    )
    caption = caption_of(study, what, band=False)
    return Drawing(figure, "Dependence between iterations", caption, "autocorrelation")


def _draw_correlation(
    axes: Axes, difference: np.ndarray, look: ArmLook, place: int, of: int
) -> str:
    """Draws one autocorrelation; returns "12.3 of 407 iterations"."""
    try:
        correlation = autocorrelation(difference)
    except ValueError as error:
        raise NotDrawnError(f"the difference of the averaged curves: {error}") from error
    total = len(difference)
    shown = max(2, int(_SHOWN_LAGS * total))
    lags = np.arange(shown)
    if place == 0:
        edge = 1.96 / np.sqrt(total)
        axes.axhspan(-edge, edge, color=GREY, alpha=0.2, linewidth=0)
        axes.axhline(0, color=GREY, linewidth=0.8)
    draw_curve(axes, lags, correlation[:shown], look, place, of)
    worth = f"{dependence(difference).effective_sample_size:.1f} of {total}"
    if of <= 2:
        _write_size(axes, worth, look, place)
    iteration_axis(axes, max(shown - 1, 1), label=False)
    return f"{worth} iterations"


def _write_size(axes: Axes, worth: str, look: ArmLook, place: int) -> None:
    axes.text(
        0.98,
        0.96 - 0.09 * place,
        f"effective sample size {worth}",
        color=look.color,
        ha="right",
        va="top",
        fontsize=6.5,
        transform=axes.transAxes,
    )
