"""Bars of how often each protocol finds a difference where there is none."""

from collections.abc import Mapping

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from analysis.data.study import Study, pretty_arm
from analysis.figures.curve_comparison import DRAW_SEED
from analysis.figures.drawing import Drawing, NotDrawnError, caption_of
from analysis.figures.series import series_of
from analysis.figures.style import (
    BLACK,
    BLUE,
    GREEN,
    GREY,
    ORANGE,
    PURPLE,
    SKY_BLUE,
    TWO_COLUMNS_IN,
    legend_above,
    new_figure,
    styled,
)
from analysis.measures.quantities import quantity
from analysis.statistics.nulls import (
    EXTREME_P,
    FalsePositiveRates,
    false_positive_rates_of_curves,
)
from tlr_exp import keys

SIMULATED = "simulated studies"
_FEWEST_SEEDS = 4  # two mock arms of two
_FILLS = (
    (BLUE, "///"),
    (ORANGE, ""),
    (GREEN, ".."),
    (PURPLE, "xx"),
    (SKY_BLUE, "\\\\"),
    (GREY, ""),
)


@styled
def figure_false_positives(
    study: Study, simulated: Mapping[str, FalsePositiveRates] | None = None
) -> Drawing:
    """False-positive rates of both protocols on the upper-body error of this study's own seeds.

    The seeds of one arm are split into two mock arms in every way: no split can show a true
    difference. Arms with fewer than four seeds are left out.

    Args:
        study: the study.
        simulated: rates in simulated studies by metric, drawn beside them.

    Raises:
        NotDrawnError: no arm has four seeds, and there are no simulated rates.
    """
    rates = {
        f"{SIMULATED}, {quantity(metric).name.lower()}": found
        for metric, found in (simulated or {}).items()
    }
    for arm in study.arms:
        if len(study.seeds(arm)) < _FEWEST_SEEDS:
            continue
        curves = series_of(study, keys.TRAIN_UPPER_BODY_ERROR, arm).values
        generator = np.random.default_rng(DRAW_SEED)
        try:
            found = false_positive_rates_of_curves(curves, generator=generator)
        except ValueError:
            continue  # a single iteration, or curves that never change
        rates[f"seeds of {pretty_arm(arm)}"] = found
    if not rates:
        raise NotDrawnError(f"no arm has {_FEWEST_SEEDS} seeds to split into two mock arms")
    return false_positive_plot(rates, study)


@styled
def false_positive_plot(rates: Mapping[str, FalsePositiveRates], study: Study) -> Drawing:
    """Bars of false-positive rates: one group per protocol, one bar per entry of ``rates``."""
    figure, axes = new_figure(TWO_COLUMNS_IN, 2.4)
    panel = axes[0, 0]
    fills = [_FILLS[place % len(_FILLS)] for place in range(len(rates))]
    for place, (one, (color, hatch)) in enumerate(zip(rates.values(), fills, strict=True)):
        _draw_bars(panel, one, (place + 0.5) / len(rates) - 0.5, 0.8 / len(rates), color, hatch)
    alpha = next(iter(rates.values())).alpha
    panel.axhline(100 * alpha, color=BLACK, linewidth=1.0, linestyle=(0, (4, 2)), zorder=3)
    panel.set_xticks(range(4), _protocols(alpha))
    panel.tick_params(axis="x", length=0)
    panel.grid(visible=False, axis="x")
    panel.set_ylim(0, 108)
    panel.set_ylabel("Called significant (%)")
    handles: list[Patch | Line2D] = [
        Patch(facecolor=color, hatch=hatch, label=label)
        for label, (color, hatch) in zip(rates, fills, strict=True)
    ]
    handles.append(
        Line2D(
            [],
            [],
            color=BLACK,
            linestyle=(0, (4, 2)),
            label=f"what it should be: {100 * alpha:g} %",
        )
    )
    legend_above(figure, handles)
    caption = caption_of(study, _what(rates), band=False)
    return Drawing(figure, "False positives of both protocols", caption, "false_positives")


def _protocols(alpha: float) -> list[str]:
    exponent = round(np.log10(EXTREME_P))
    return [
        f"paired t over iterations\n(p ≤ {alpha:g})",
        f"paired t over iterations\n(p < $10^{{{exponent}}}$)",
        f"Welch t over seeds\n(p ≤ {alpha:g})",
        f"permutation of seeds\n(p ≤ {alpha:g})",
    ]


def _draw_bars(
    axes: Axes, rates: FalsePositiveRates, offset: float, width: float, color: str, hatch: str
) -> None:
    shares = (rates.iteration_t, rates.iteration_t_extreme, rates.welch, rates.permutation)
    for protocol, share in enumerate(shares):
        at = protocol + 0.8 * offset
        axes.bar(at, 100 * share, 0.92 * width, color=color, hatch=hatch, edgecolor="white")
        above = 100 * (rates.alpha if share <= rates.alpha else share)  # not on the dashed line
        axes.text(at, above + 1.5, f"{100 * share:.3g}", ha="center", fontsize=6.5)


def _what(rates: Mapping[str, FalsePositiveRates]) -> str:
    each = "; ".join(
        f"{label}: {one.num_studies} cases of {one.num_seeds[0]} against {one.num_seeds[1]} seeds, "
        f"{one.num_iterations} iterations"
        for label, one in rates.items()
    )
    return (
        "Share of cases without any true difference that a test calls significant, in per cent. "
        "A paired t over iterations takes those of seed-averaged curves as independent pairs; "
        "the others take one number per seed, the mean over the last 20 % of the iterations. "
        f"{each}. Seeds of one arm are split into two mock arms in every way; such splits share "
        "seeds, and so few seeds may be unable to give a permutation p of 0.05 at all."
    )
