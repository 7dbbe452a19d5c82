"""Several motions in one figure: the improvement on each and on all, and performance profiles."""

from collections.abc import Mapping, Sequence

import numpy as np

from analysis.data.study import Study, pretty_arm
from analysis.figures.drawing import Drawing, caption_of
from analysis.figures.style import (
    BLACK,
    GREY,
    PAPER_COLUMN_IN,
    TWO_COLUMNS_IN,
    arm_looks,
    legend_above,
    new_figure,
    styled,
)
from analysis.measures.motions import OverMotions
from analysis.statistics.motions import Profile
from analysis.statistics.results import Interval

MOTIONS, PROFILES = OF_MOTIONS = ("motions", "profiles")  # stems of the files


@styled
def figure_motions(
    studies: Mapping[str, Study],
    treatment: str,
    columns: Sequence[tuple[OverMotions, Mapping[str, Interval], Interval]],
) -> Drawing:
    """The relative improvement on every motion, and below them that of all, a panel per measure.

    Args:
        studies: by motion, with the same arms.
        treatment: the arm that is compared with the baseline.
        columns: measures with their improvements (shares) by motion, and that over all motions.
    """
    look = arm_looks(next(iter(studies.values())).arms)[treatment]
    rows = [*studies, "all motions"]
    figure, axes = new_figure(TWO_COLUMNS_IN, 0.9 + 0.24 * len(rows), columns=len(columns))
    for panel, (measure, by_motion, pooled) in zip(axes[0], columns, strict=True):
        for height, interval in enumerate([*by_motion.values(), pooled]):
            color = BLACK if height == len(by_motion) else look.color
            if np.isfinite(interval.low):
                ends = [100 * interval.low, 100 * interval.high]
                panel.plot(ends, [height, height], color=color, linewidth=1.3)
            if np.isfinite(interval.estimate):
                panel.plot(100 * interval.estimate, height, look.marker, color=color, markersize=4)
        panel.axvline(0, color=GREY, linewidth=0.8, zorder=1.5)
        panel.axhline(len(by_motion) - 0.5, color=GREY, linewidth=0.5)
        panel.set_ylim(len(rows) - 0.5, -0.5)
        panel.set_yticks(range(len(rows)), rows if panel is axes[0, 0] else [""] * len(rows))
        panel.tick_params(axis="y", length=0)
        panel.grid(visible=False, axis="y")
        panel.set_title(f"{measure.shown.name},\n{measure.endpoint}")
        panel.set_xlabel("improvement (%)")
    arms = f"{pretty_arm(treatment)} over {pretty_arm(next(iter(studies.values())).baseline)}"
    what = (
        f"Relative improvement of {arms}, with 95 % intervals over seeds; right of 0 is better. "
        "On a motion: of the means, by Fieller. All motions: of the geometric mean of the motions' "
        "ratios, by t over motions."
    )
    caption = caption_of(next(iter(studies.values())), what, band=False)
    return Drawing(figure, "Improvement by motion", caption, MOTIONS)


@styled
def figure_profiles(
    studies: Mapping[str, Study],
    treatment: str,
    measure: OverMotions,
    profiles: tuple[Profile, Profile],
) -> Drawing:
    """The share of runs at least as good as a threshold, every motion counting alike."""
    study = next(iter(studies.values()))
    looks = arm_looks(study.arms)
    figure, axes = new_figure(PAPER_COLUMN_IN, 2.4)
    panel = axes[0, 0]
    for arm, profile in zip((study.baseline, treatment), profiles, strict=True):
        look = looks[arm]
        panel.plot(profile.thresholds, profile.share, color=look.color, label=pretty_arm(arm))
        panel.fill_between(
            profile.thresholds, profile.low, profile.high, color=look.color, alpha=0.2, linewidth=0
        )
    panel.set_xlabel(f"{measure.shown.name}, share of the baseline's mean")
    panel.set_ylabel("share of runs at least as good")
    panel.set_ylim(0, 1.02)
    legend_above(figure, panel.get_lines())
    what = (
        f"Performance profile of {measure.shown.name.lower()} ({measure.endpoint}): the share of "
        "runs whose value, divided by the baseline's mean on the same motion, is at least as good "
        "as the threshold; the mean over motions. Bands: pointwise 95 % intervals, seeds drawn "
        "anew within motions."
    )
    return Drawing(figure, "Performance profiles", caption_of(study, what, band=False), PROFILES)
