"""Curves of what a policy gets wrong: joint by joint, body by body."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from tlr_exp.evaluation.distances import body_distance
from tlr_exp.evaluation.result import EvaluationResult
from tlr_exp.evaluation.trajectory import Trajectory
from tlr_exp.robot.spec import SIDES, RobotSpec

# Okabe and Ito's colours, which colour-blind readers tell apart.
_REFERENCE, _ROBOT, _UPPER, _LOWER, _END = "#333333", "#0072B2", "#D55E00", "#0072B2", "#CC3311"


def _joint_rows(spec: RobotSpec) -> list[list[int]]:
    """Rows of the figure of joints: the two legs, and arms and waist beside one another."""
    half = (len(spec.waist) + 1) // 2
    waist = dict(zip(SIDES, (spec.waist[:half], spec.waist[half:]), strict=True))
    limbs = [(side, spec.legs) for side in SIDES]
    limbs += [(side, (*spec.arms, *waist[side])) for side in SIDES]
    place = {(joint.side, joint.kind): i for i, joint in enumerate(spec.joints)}
    return [
        [place["" if kind in spec.waist else side, kind] for kind in kinds] for side, kinds in limbs
    ]


def joint_error_figure(trajectory: Trajectory, title: str) -> Figure:
    """The joints over the time in s: robot and reference in rad, and the mean of |error|."""
    figure = Figure(figsize=(17, 9.5), layout="constrained")
    figure.suptitle(title)
    rows = _joint_rows(trajectory.spec)
    axes = figure.subplots(len(rows), max(map(len, rows)), sharex=True, squeeze=False)
    for panels, joints in zip(axes, rows, strict=True):
        for axis, joint in zip(panels, joints, strict=False):
            _joint_panel(axis, trajectory, joint)
        panels[0].set_ylabel("rad")
        for axis in panels[len(joints) :]:
            axis.axis("off")
    # The lowest panel of each column has the times.
    for column in axes.T:
        lowest = [axis for axis in column if axis.axison][-1]
        lowest.set_xlabel("s")
        lowest.tick_params(labelbottom=True)
    last = axes[-1, -1]
    last.legend(
        *axes[0, 0].get_legend_handles_labels(),
        title="in titles: mean |error|",
        loc="center left",
        frameon=False,
    )
    return figure


def _joint_panel(axis: Axes, trajectory: Trajectory, joint: int) -> None:
    robot, reference = trajectory.qpos[:, 7 + joint], trajectory.reference_qpos[:, 7 + joint]
    time = _time(trajectory)
    axis.plot(time, reference, color=_REFERENCE, linewidth=1.0, label="reference")
    axis.plot(time, robot, color=_ROBOT, linewidth=1.2, label="robot")
    axis.fill_between(time, reference, robot, color=_ROBOT, alpha=0.15, linewidth=0)
    name = trajectory.spec.joint_names[joint].removesuffix("_joint").replace("_", " ")
    axis.set_title(f"{name}: {np.abs(robot - reference).mean():.3f} rad", fontsize=10)
    axis.tick_params(labelsize=8)
    axis.grid(alpha=0.3)


def body_error_figure(trajectory: Trajectory, result: EvaluationResult, title: str) -> Figure:
    """Distance of the bodies from their reference in m: means, each over time, each on average."""
    distance = body_distance(trajectory.body_pos_w, trajectory.reference_body_pos_w)
    figure = Figure(figsize=(13, 10), layout="constrained")
    figure.suptitle(title)
    axes = figure.subplots(2, 2, gridspec_kw={"height_ratios": [2, 5], "width_ratios": [4, 1]})
    time = _time(trajectory)
    mean, image, bars = axes[0, 0], axes[1, 0], axes[1, 1]
    axes[0, 1].axis("off")
    spec = trajectory.spec
    groups = (("upper body", spec.upper_body, _UPPER), ("lower body", spec.lower_body, _LOWER))
    for label, bodies, color in groups:
        mean.plot(time, distance[:, bodies].mean(axis=1), color=color, label=label)
    _mark_end(mean, result.upright, "fell", trajectory, "-")
    _mark_end(mean, result.survival, "training would have stopped", trajectory, ":")
    mean.set_ylabel("mean distance, m")
    mean.set_ylim(bottom=0)
    mean.grid(alpha=0.3)
    mean.set_xlim(0, time[-1])
    handles, labels = mean.get_legend_handles_labels()
    axes[0, 1].legend(handles, labels, loc="center left", frameon=False)
    # Upper body above, lower body below; in each the worst first.
    order = [
        body
        for _, bodies, _ in groups
        for body in sorted(bodies, key=lambda index: -distance[:, index].mean())
    ]
    # A row begins where its step does and ends with the instant that it describes.
    extent = (0.0, time[-1], len(order) - 0.5, -0.5)
    colors = image.imshow(
        distance[:, order].T,
        **{"aspect": "auto", "cmap": "viridis", "extent": extent, "vmin": 0.0},
        interpolation="nearest",
    )
    names = [spec.tracked_bodies[body].removesuffix("_link") for body in order]
    image.set_yticks(range(len(order)), names, fontsize=8)
    image.set_xlabel("s")
    figure.colorbar(colors, ax=image, label="distance, m", location="left", pad=0.01)
    shades = [_UPPER if body in spec.upper_body else _LOWER for body in order]
    bars.barh(range(len(order)), distance[:, order].mean(axis=0), color=shades)
    bars.set_ylim(len(order) - 0.5, -0.5)
    bars.set_yticks([])
    bars.set_xlabel("mean distance, m")
    bars.grid(axis="x", alpha=0.3)
    return figure


def _mark_end(axis: Axes, share: float, label: str, trajectory: Trajectory, style: str) -> None:
    """A line where something happened, if it did."""
    if share < 1.0:
        # The share is of the steps before: the step itself ends one later.
        step = round(share * trajectory.num_steps) + 1
        time = step * trajectory.control_dt_s
        axis.axvline(time, color=_END, linestyle=style, label=f"{label} ({time:.2f} s)")


def _time(trajectory: Trajectory) -> np.ndarray:
    return (np.arange(trajectory.num_steps) + 1) * trajectory.control_dt_s
