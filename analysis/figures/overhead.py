"""Figure 15: what the weight search costs per iteration."""

import numpy as np

from analysis.data.study import Study, pretty_arm
from analysis.figures.drawing import Drawing, NotDrawnError, caption_of
from analysis.figures.lines import arm_legend, draw_arms, plain_log_axis
from analysis.figures.series import Series, all_series, column, with_metric
from analysis.figures.style import (
    TWO_COLUMNS_IN,
    arm_looks,
    new_figure,
    panel_letter,
    styled,
)
from tlr_exp import keys

WEIGHTS_S = f"{keys.TIME_PREFIX}weights_s"
ITERATION_S = f"{keys.TIME_PREFIX}iteration_s"
EVALUATE_S = f"{keys.TIME_PREFIX}evaluate_s"
_SHARE = "share of the iteration, per cent"


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
    caption = caption_of(study, _what(seconds, share), band=True)
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


def _what(seconds: dict[str, Series], share: dict[str, Series]) -> str:
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
