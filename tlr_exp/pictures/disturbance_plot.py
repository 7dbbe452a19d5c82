"""Success and errors under disturbances, the arms of a study side by side."""

from collections.abc import Sequence
from dataclasses import dataclass
from statistics import fmean

from matplotlib.axes import Axes
from matplotlib.figure import Figure

# Okabe and Ito's colours, which colour-blind readers tell apart.
_COLORS = ("#333333", "#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")
_PANELS = (
    ("success", "share of roll-outs without a failure"),
    ("upper_body_error_m", "upper-body error, m"),
    ("lower_body_error_m", "lower-body error, m"),
)


@dataclass(frozen=True)
class DisturbedRun:
    """A run under one disturbance: means over its roll-outs; ``success`` is their share."""

    motion: str
    disturbance: str
    arm: str
    success: float
    upper_body_error_m: float
    lower_body_error_m: float


def disturbance_figure(runs: Sequence[DisturbedRun], title: str) -> Figure:
    """A row of panels for each motion, in them a line for each disturbance, in the runs' order.

    Of each arm the mean over its runs is a filled mark, the runs are open ones.
    """
    motions = sorted({run.motion for run in runs})
    disturbances = list(dict.fromkeys(run.disturbance for run in runs))
    arms = sorted({run.arm for run in runs})
    height = 1.2 + len(motions) * (0.8 + 0.35 * len(disturbances) * max(1.0, len(arms) / 2))
    figure = Figure(figsize=(11, height), layout="constrained")
    figure.suptitle(title)
    axes = figure.subplots(len(motions), len(_PANELS), squeeze=False, sharey=True)
    for row, motion in enumerate(motions):
        of_motion = [run for run in runs if run.motion == motion]
        for axis, (measure, label) in zip(axes[row], _PANELS, strict=True):
            for number, arm in enumerate(arms):
                of_arm = [run for run in of_motion if run.arm == arm]
                shift = 0.6 * ((number + 0.5) / len(arms) - 0.5)
                _marks(axis, of_arm, disturbances, measure, shift, _COLORS[number % len(_COLORS)])
            axis.set_xlabel(label)
            axis.set_xlim(left=-0.03 if measure == "success" else 0.0)
            axis.grid(axis="x", alpha=0.3)
        axes[row, 0].set_xlim(-0.03, 1.03)
        axes[row, 0].set_yticks(range(len(disturbances)), disturbances)
        axes[row, 0].set_ylim(len(disturbances) - 0.5, -0.5)
        axes[row, 0].set_ylabel(motion)
    for number, arm in enumerate(arms):
        axes[0, 0].plot([], [], "o", color=_COLORS[number % len(_COLORS)], label=arm)
    figure.legend(loc="outside lower center", ncols=min(len(arms), 4), frameon=False)
    return figure


def _marks(
    axis: Axes,
    runs: Sequence[DisturbedRun],
    disturbances: Sequence[str],
    measure: str,
    shift: float,
    color: str,
) -> None:
    for place, disturbance in enumerate(disturbances):
        values = [getattr(run, measure) for run in runs if run.disturbance == disturbance]
        if not values:
            continue
        height = place + shift
        axis.plot(values, [height] * len(values), "o", color=color, mfc="none", ms=4, alpha=0.7)
        axis.plot([fmean(values)], [height], "o", color=color, ms=7)
