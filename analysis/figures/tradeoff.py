"""Tracking error against lower-layer cost: who moves better for the same tracking."""

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import Polygon
from scipy.spatial import ConvexHull, QhullError

from analysis.data.study import Study, StudyError
from analysis.figures.drawing import Drawing, NotDrawnError, caption_of
from analysis.figures.style import (
    BLACK,
    GREY,
    ArmLook,
    arm_looks,
    legend_above,
    new_figure,
    styled,
)
from analysis.measures.quantities import COST, COST_OF_ROLL_OUT
from analysis.measures.tradeoff import tradeoff_of
from analysis.statistics.pareto import MARGIN, on_front

_CLOUD_ALPHA = 0.15
FRONT = "Pareto front of all runs"


@styled
def figure_tradeoff(study: Study) -> Drawing:
    """Every run as a point, every arm as a cloud with its mean, and the front of all runs.

    Raises:
        NotDrawnError: errors or terms of the lower layer were not measured without noise.
    """
    try:
        found = tradeoff_of(study)
    except StudyError as reason:
        raise NotDrawnError(str(reason)) from reason
    looks = arm_looks(study.arms)
    figure, axes = new_figure(5.0, 3.3)
    panel = axes[0, 0]
    for arm, points in found.points.items():
        _draw_arm(panel, points, looks[arm])
    _draw_front(panel, np.concatenate([*found.points.values()]))
    panel.set_xlabel(f"{COST_OF_ROLL_OUT[COST].label}; left: moves better")
    panel.set_ylabel("Mean error of both bodies (m)")
    handles = [Line2D([], [], **{**looks[arm].line, "linestyle": "none"}) for arm in found.points]
    handles.append(Line2D([], [], color=BLACK, linewidth=0.9, label=FRONT))
    legend_above(figure, handles)
    what = (
        "Mean of upper- and lower-body error, in metres, against what the lower layer of the "
        "baseline takes from the reward in a second at weights 1 (the same measure in every arm); "
        f"{found.source}. Small points: runs, one per seed; large, open ones: the mean of an arm; "
        "shaded: the hull of its runs. Below and to the left is better; a run on the black line "
        "is beaten by no other in both."
    )
    caption = caption_of(study, what, band=False)
    title = "Tracking error against lower-layer cost"
    return Drawing(figure, title, caption, "tradeoff")


def _draw_arm(axes: Axes, points: np.ndarray, look: ArmLook) -> None:
    hull = hull_of(points)
    if hull is not None:
        axes.add_patch(
            Polygon(hull, facecolor=look.color, alpha=_CLOUD_ALPHA, edgecolor="none", zorder=1.5)
        )
    marker: dict[str, Any] = {"marker": look.marker, "linestyle": "none", "color": look.color}
    axes.plot(points[:, 0], points[:, 1], markersize=4, markeredgewidth=0, zorder=3, **marker)
    mean = points.mean(axis=0)
    axes.plot(
        *mean,
        markersize=10,
        markerfacecolor="none",
        markeredgecolor=look.color,
        markeredgewidth=1.4,
        zorder=3.5,
        **marker,
    )


def hull_of(points: np.ndarray) -> np.ndarray | None:
    """Corners [k, 2] of the convex hull of points [n, 2]; None where it has no area."""
    if len(points) < 3:
        return None
    try:
        return points[ConvexHull(points).vertices]
    except QhullError:  # all on one line
        return None


def _draw_front(axes: Axes, points: np.ndarray) -> None:
    """The staircase that bounds what some run dominates, to the edges of the panel."""
    low, high = points.min(axis=0), points.max(axis=0)
    reach = np.where(high > low, high - low, 0.05 * np.abs(high) + 1e-9)
    (left, bottom), (right, top) = low - MARGIN * reach, high + MARGIN * reach
    front = points[on_front(points)]
    front = front[np.lexsort((front[:, 1], front[:, 0]))]
    x = np.concatenate([[front[0, 0]], front[:, 0], [right]])
    y = np.concatenate([[top], front[:, 1], [front[-1, 1]]])
    axes.plot(x, y, drawstyle="steps-post", color=BLACK, linewidth=0.9, zorder=2)
    axes.plot([right], [top], "+", color=GREY, markersize=5, clip_on=False, zorder=2)
    axes.set_xlim(left, right)
    axes.set_ylim(bottom, top)
