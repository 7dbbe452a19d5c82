"""Bars of where the time of an iteration goes; Figure 15: what the weight search takes of it."""

from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Patch

from analysis.data.study import Study, pretty_arm
from analysis.figures.drawing import Drawing, NotDrawnError, caption_of
from analysis.figures.lines import arm_legend, draw_arms, plain_log_axis
from analysis.figures.series import Series, all_series, column, with_metric
from analysis.figures.style import (
    BLACK,
    BLUE,
    GREEN,
    GREY,
    ORANGE,
    PURPLE,
    SKY_BLUE,
    TWO_COLUMNS_IN,
    VERMILLION,
    arm_looks,
    legend_above,
    new_figure,
    panel_letter,
    styled,
)
from analysis.measures.quantities import EVALUATE_S, ITERATION_S, WEIGHTS_S
from tlr_exp import keys

_SHARE = "share of the iteration, per cent"
_OTHER = "other"
# Phase, its name, colour and hatch, in the order of an iteration.
_PHASES = (
    ("collect", "collect", SKY_BLUE, ""),
    ("weights", "weights", VERMILLION, "///"),
    ("advantage", "advantage", GREEN, ".."),
    ("update", "update", BLUE, ""),
    ("landscape", "landscape", PURPLE, "xx"),
    ("evaluate", "evaluate", ORANGE, "\\\\\\"),
    (_OTHER, "other", GREY, ""),
)
_LABEL_FROM = 0.06  # of the longest bar: a number in a shorter segment would not fit


@dataclass(frozen=True)
class Split:
    """Mean seconds of an iteration by phase, and their sum's spread between seeds."""

    seconds: dict[str, float]
    per_seed: np.ndarray  # [n], seconds of an iteration

    @property
    def total(self) -> float:
        return sum(self.seconds.values())


@styled
def figure_wall_clock(study: Study) -> Drawing:
    """Stacked bars, one per arm: seconds of a mean iteration by phase.

    Raises:
        NotDrawnError: the times of the iterations were not recorded.
    """
    splits = {arm: wall_clock_split(study, arm) for arm in study.arms}
    figure, axes = new_figure(TWO_COLUMNS_IN, 0.85 + 0.36 * len(study.arms))
    panel = axes[0, 0]
    for place, split in enumerate(splits.values()):
        _draw_bar(panel, place, split, max(each.total for each in splits.values()))
    panel.set_yticks(range(len(splits)), [pretty_arm(arm) for arm in splits])
    panel.invert_yaxis()
    panel.grid(visible=False, axis="y")
    panel.tick_params(axis="y", length=0)
    panel.set_xlabel("Mean wall-clock time of an iteration (s)")
    shown = [p for p in _PHASES if any(s.seconds.get(p[0], 0.0) > 0 for s in splits.values())]
    legend_above(
        figure,
        [Patch(facecolor=color, hatch=hatch, label=name) for _, name, color, hatch in shown],
    )
    caption = caption_of(study, _what(splits), band=False)
    return Drawing(figure, "Wall-clock time of an iteration", caption, "wall_clock_split")


def wall_clock_split(study: Study, arm: str) -> Split:
    """Mean seconds per iteration and phase over all iterations and seeds of an arm.

    A phase that only some iterations have (the evaluation) is spread over all of them. "other" is
    what the recorded phases leave of the whole iteration.

    Raises:
        NotDrawnError: the times of the iterations were not recorded.
    """
    rows = study.curves["arm"] == arm
    runs = np.asarray(study.curves.loc[rows, "run"])
    if ITERATION_S not in study.metric_names or np.isnan(column(study, ITERATION_S)[rows]).all():
        raise NotDrawnError(f"arm {arm!r} has no value of {ITERATION_S}")
    seconds = {}
    for phase, *_ in _PHASES:
        metric = f"{keys.TIME_PREFIX}{phase}_s"
        if metric in study.metric_names:
            seconds[phase] = float(_mean_per_run(column(study, metric)[rows], runs).mean())
    per_seed = _mean_per_run(column(study, ITERATION_S)[rows], runs)
    seconds[_OTHER] = max(0.0, float(per_seed.mean()) - sum(seconds.values()))
    return Split(seconds, per_seed)


def _mean_per_run(values: np.ndarray, runs: np.ndarray) -> np.ndarray:
    """Mean over the iterations of each run, [n]; an iteration without the phase took no time."""
    return np.array([np.nan_to_num(values[runs == run]).mean() for run in np.unique(runs)])


def _draw_bar(axes: Axes, place: int, split: Split, longest: float) -> None:
    left = 0.0
    for phase, _, color, hatch in _PHASES:
        width = split.seconds.get(phase, 0.0)
        if width <= 0:
            continue
        axes.barh(
            place,
            width,
            left=left,
            height=0.72,
            color=color,
            hatch=hatch,
            edgecolor="white",
            linewidth=0.4,
        )
        if width > _LABEL_FROM * longest:
            text = f"{width:.2f} s\n{100 * width / split.total:.0f} %"
            pale = color in (SKY_BLUE, ORANGE, GREEN, PURPLE)
            axes.text(
                left + width / 2,
                place,
                text,
                ha="center",
                va="center",
                fontsize=6,
                linespacing=1.0,
                color=BLACK if pale else "white",
            )
        left += width
    spread = f" ± {split.per_seed.std(ddof=1):.2f}" if len(split.per_seed) > 1 else ""
    axes.text(
        left + 0.01 * longest, place, f"{split.total:.2f}{spread} s", va="center", fontsize=6.5
    )
    axes.set_xlim(0, max(axes.get_xlim()[1], 1.14 * longest))


def _what(splits: dict[str, Split]) -> str:
    weights = "; ".join(
        f"{pretty_arm(arm)} {1000 * split.seconds.get('weights', 0.0):.3g} ms"
        for arm, split in splits.items()
    )
    return (
        "Mean wall-clock time of an iteration in seconds, by phase, over all iterations and "
        "seeds: collecting the batch, searching the weights, estimating advantages, updating the "
        "policy, measuring how much of the weight box is optimal (landscape, a metric only), "
        "evaluating (in some iterations only, spread over all) and what remains (other). At the "
        "right: the whole iteration, ± 1 standard deviation between seeds where there is more "
        f"than one. Weight search: {weights}."
    )


# --- Figure 15 -------------------------------------------------------------------------------
@styled
def figure_15(study: Study) -> Drawing:
    """Seconds of the weight search per iteration, and their share of the iteration, per arm.

    Raises:
        NotDrawnError: the times were not recorded.
    """
    timed = with_metric(study, _SHARE, 100 * overhead_share(study))
    seconds, share = all_series(timed, WEIGHTS_S), all_series(timed, _SHARE)
    looks = arm_looks(study.arms)
    figure, axes = new_figure(TWO_COLUMNS_IN, 2.3, columns=2)
    for panel, series in zip(axes[0], (seconds, share), strict=True):
        draw_arms(panel, series, looks, floor=True)
        plain_log_axis(panel)  # the arms differ by orders of magnitude
    panel_letter(axes[0, 0], "a", "Time of the weight search")
    panel_letter(axes[0, 1], "b", "Share of the iteration")
    axes[0, 0].set_ylabel("Weight search per iteration (s)")
    axes[0, 1].set_ylabel("Share of the iteration (%)")
    arm_legend(figure, list(looks.values()))
    caption = caption_of(study, _what_overhead(seconds, share), band=True)
    return Drawing(figure, "Overhead of the weight search", caption, "figure_15_overhead")


def overhead_share(study: Study) -> np.ndarray:
    """Time of the weight search over that of its iteration without the evaluation, per row.

    Raises:
        NotDrawnError: the times were not recorded.
    """
    missing = [name for name in (WEIGHTS_S, ITERATION_S) if name not in study.metric_names]
    if missing:
        raise NotDrawnError(f"the study has no metric {', '.join(missing)}")
    return column(study, WEIGHTS_S) / iteration_without_evaluation(study)


def iteration_without_evaluation(study: Study) -> np.ndarray:
    """Seconds of each iteration less those of the evaluation, which only some iterations have."""
    iteration = column(study, ITERATION_S)
    if EVALUATE_S not in study.metric_names:
        return iteration
    return iteration - np.nan_to_num(column(study, EVALUATE_S), nan=0.0)


def _what_overhead(seconds: dict[str, Series], share: dict[str, Series]) -> str:
    each = []
    for arm, one in seconds.items():
        per_seed = one.values.mean(axis=1)
        spread = f" ± {per_seed.std(ddof=1):.2g}" if len(per_seed) > 1 else ""
        percent = share[arm].values.mean()
        each.append(f"{pretty_arm(arm)} {per_seed.mean():.3g}{spread} s ({percent:.2g} %)")
    return (
        "Wall-clock time that finding the weights takes in each iteration, in seconds, and its "
        "share of the iteration without the evaluation, in per cent; logarithmic axes. Mean over "
        f"the training (± 1 standard deviation between seeds): {'; '.join(each)}."
    )
