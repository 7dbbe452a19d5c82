"""Curves over time: of a clip, and of what a policy gets wrong; joint by joint, body by body."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from tlr_exp.evaluation.distances import body_distance
from tlr_exp.evaluation.result import EvaluationResult
from tlr_exp.evaluation.trajectory import Trajectory
from tlr_exp.motion.checks import QPOS_JOINTS
from tlr_exp.motion.clip import MotionClip
from tlr_exp.motion.quality.floor import FloorContacts, floor_contacts, stretches
from tlr_exp.robot.model import Robot
from tlr_exp.robot.spec import SIDES, RobotSpec

# Okabe and Ito's colours, which colour-blind readers tell apart.
LEFT, RIGHT, MIDDLE, LIMIT, FLIGHT = "#0072B2", "#D55E00", "#333333", "#CC3311", "#F0E442"
_COLORS = {"left": LEFT, "right": RIGHT, "": MIDDLE}  # by the side of a joint
_REFERENCE, _ROBOT, _UPPER, _LOWER, _END = MIDDLE, LEFT, RIGHT, LEFT, LIMIT
# The left is broad and light, so that it shows where the right lies on it.
_LINES = {
    LEFT: {"color": LEFT, "linewidth": 2.8, "alpha": 0.5},
    RIGHT: {"color": RIGHT, "linewidth": 1.1},
    MIDDLE: {"color": MIDDLE, "linewidth": 1.2},
}


# --- a clip -----------------------------------------------------------------------------------
def joint_figure(clip: MotionClip, robot: Robot, title: str) -> Figure:
    """Positions and velocities of the 23 joints, left and right in one panel.

    What is beyond a joint's limits is shaded; where a limit is out of sight it is written in.
    Roll and yaw joints of the right side change sign, so that both sides have the same limits.
    """
    figure = _titled(title, 19, 9)
    legs, upper = robot.spec.legs, (*robot.spec.waist, *robot.spec.arms)
    axes = figure.subplots(4, max(len(legs) + 1, len(upper)), sharex=True)
    for rows, kinds in ((axes[:2], legs), (axes[2:], upper)):
        for column, kind in enumerate(kinds):
            _joint_panels(rows[:, column], clip, robot, kind)
        for axis in rows[:, len(kinds) :].flat:
            axis.axis("off")
    for row, text in enumerate(["rad", "rad/s"] * 2):
        axes[row, 0].set_ylabel(text)
    for axis in axes[3]:
        axis.set_xlabel("s")
    corner = axes[0, -1]
    handles = [
        corner.plot([], [], label=label, **_LINES[color])[0]
        for color, label in (
            *((LEFT, "left"), (RIGHT, "right (roll and yaw mirrored)"), (MIDDLE, "waist")),
        )
    ]
    handles.append(corner.fill_between([], [], [], color=LIMIT, alpha=0.15, label="beyond"))
    corner.legend(handles=handles, loc="center left", frameon=False)
    return figure


def _joint_panels(axes: np.ndarray, clip: MotionClip, robot: Robot, kind: str) -> None:
    position, speed = clip.qpos[:, QPOS_JOINTS], clip.qvel[:, 6:]
    time = np.arange(clip.num_frames) / clip.fps
    joints = [i for i, joint in enumerate(robot.spec.joints) if joint.kind == kind]
    for joint in joints:
        side = robot.spec.joints[joint].side
        mirror = -1.0 if side == "right" and kind in robot.spec.mirrored else 1.0
        axes[0].plot(time, mirror * position[:, joint], **_LINES[_COLORS[side]])
        axes[1].plot(time, mirror * speed[:, joint], **_LINES[_COLORS[side]])
    first = joints[0]
    low, high = robot.joint_range_rad[first]
    fastest = robot.velocity_limit_rad_s[first]
    axes[0].set_title(kind.replace("_", " "), fontsize=10)
    _show_limits(axes[0], low, high, least=0.4)
    _show_limits(axes[1], -fastest, fastest, least=1.0)


def _show_limits(axis: Axes, low: float, high: float, least: float) -> None:
    """Fit the view to the curves (``least`` high or more); shade and write the limits."""
    curves = np.concatenate([np.asarray(line.get_ydata()) for line in axis.get_lines()])
    middle, half = (curves.max() + curves.min()) / 2, max(np.ptp(curves), least) / 2
    axis.set_ylim(middle - 1.35 * half, middle + 1.35 * half)
    bottom, top = axis.get_ylim()
    axis.axhspan(high, max(top, high), color=LIMIT, alpha=0.15, linewidth=0)
    axis.axhspan(min(bottom, low), low, color=LIMIT, alpha=0.15, linewidth=0)
    axis.set_ylim(bottom, top)
    limits = f"±{high:g}" if low == -high else f"{low:.2f} to {high:.2f}"
    axis.text(
        *(0.98, 0.03, limits),
        **{"transform": axis.transAxes, "ha": "right", "fontsize": 7, "color": "#666666"},
    )
    axis.grid(alpha=0.3)
    axis.tick_params(labelsize=8)


def body_figure(clip: MotionClip, robot: Robot, title: str) -> Figure:
    """Heights and speeds of the ends of the body, who touches the floor, speeds of all bodies."""
    floor = floor_contacts(clip, robot)
    figure = _titled(title, 12, 11)
    height, speed, contact, image = figure.subplots(
        4, 1, sharex=True, gridspec_kw={"height_ratios": [3, 3, 0.7, 5]}
    )
    time = np.arange(clip.num_frames) / clip.fps
    speeds = np.linalg.norm(clip.body_lin_vel_w, axis=-1)
    for body, label, color, style in _shown_bodies(robot.spec):
        line = {**_LINES[color], "linestyle": style}
        height.plot(time, clip.body_pos_w[:, body, 2], label=label, **line)
        speed.plot(time, speeds[:, body], label=label, **line)
    lowest = {"color": "#009E73", "linewidth": 1.0, "label": "lowest point"}
    height.plot(time, floor.lowest, **lowest)
    height.axhline(0.0, color="black", linewidth=0.6)
    height.set_ylabel("height, m")
    speed.set_ylabel("speed, m/s")
    height.legend(
        ncols=7, fontsize=8, loc="upper center", bbox_to_anchor=(0.5, 1.14), frameon=False
    )
    _contact_bars(contact, clip, floor)
    # Half a frame before and after, so that each frame's colour is around its time.
    times = (-0.5 / clip.fps, time[-1] + 0.5 / clip.fps)
    names = robot.spec.tracked_bodies
    colors = _body_image(image, speeds, names, range(len(names)), times, label_size=7)
    figure.colorbar(colors, ax=image, label="speed, m/s", pad=0.01)
    for axis in (height, speed):
        axis.grid(alpha=0.3)
    return figure


def _shown_bodies(spec: RobotSpec) -> list[tuple[int, str, str, str]]:
    """The ends of the body: index, label, colour, line style."""
    middle = ((spec.head_name, "head", MIDDLE, ":"), (spec.pelvis_name, "pelvis", MIDDLE, "-"))
    pairs = (("hand", spec.hand_names, "--"), ("foot", spec.foot_names, "-"))
    sided = (
        (name, f"{side} {what}", _COLORS[side], style)
        for what, names, style in pairs
        for side, name in zip(SIDES, names, strict=True)
    )
    return [
        (spec.tracked_bodies.index(name), label, color, style)
        for name, label, color, style in (*middle, *sided)
    ]


def _contact_bars(axis: Axes, clip: MotionClip, floor: FloorContacts) -> None:
    for row, (flags, color) in enumerate(
        ((floor.contact[0], LEFT), (floor.contact[1], RIGHT), (floor.flight, FLIGHT))
    ):
        bars = [(start / clip.fps, (end - start) / clip.fps) for start, end in stretches(flags)]
        axis.broken_barh(bars, (2 - row - 0.4, 0.8), color=color)
    axis.set_yticks([2, 1, 0], ["left foot on floor", "right foot on floor", "free flight"])
    axis.tick_params(axis="y", labelsize=8)
    axis.set_ylim(-0.6, 2.6)


# --- a policy beside its reference ------------------------------------------------------------
def joint_error_figure(trajectory: Trajectory, title: str) -> Figure:
    """The joints over the time in s: robot and reference in rad, and the mean of |error|."""
    figure = _titled(title, 17, 9.5)
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
    figure = _titled(title, 13, 10)
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
    mean.set(ylabel="mean distance, m", xlim=(0, time[-1]))
    mean.set_ylim(bottom=0)
    mean.grid(alpha=0.3)
    axes[0, 1].legend(*mean.get_legend_handles_labels(), loc="center left", frameon=False)
    # Upper body above, lower body below; in each the worst first.
    order = [
        body
        for _, bodies, _ in groups
        for body in sorted(bodies, key=lambda index: -distance[:, index].mean())
    ]
    # A row begins where its step does and ends with the instant that it describes.
    colors = _body_image(image, distance, spec.tracked_bodies, order, (0.0, time[-1]), label_size=8)
    figure.colorbar(colors, ax=image, label="distance, m", location="left", pad=0.01)
    shades = [_UPPER if body in spec.upper_body else _LOWER for body in order]
    bars.barh(range(len(order)), distance[:, order].mean(axis=0), color=shades)
    bars.set(ylim=(len(order) - 0.5, -0.5), yticks=[], xlabel="mean distance, m")
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


# --- both -------------------------------------------------------------------------------------
def _titled(title: str, width_in: float, height_in: float) -> Figure:
    figure = Figure(figsize=(width_in, height_in), layout="constrained")
    figure.suptitle(title)
    return figure


def _body_image(
    axis: Axes,
    values: np.ndarray,
    names: Sequence[str],
    bodies: Sequence[int],
    times_s: tuple[float, float],
    label_size: int,
) -> Any:
    """Values [T, num_bodies] as colours over the time, a row for each of ``bodies``.

    Returns what has the colours; ``names`` are those of all bodies.
    """
    rows = [names[body].removesuffix("_link") for body in bodies]
    colors = axis.imshow(
        values[:, list(bodies)].T,
        aspect="auto",
        cmap="viridis",
        extent=(*times_s, len(rows) - 0.5, -0.5),
        vmin=0.0,
        interpolation="nearest",
    )
    axis.set_yticks(range(len(rows)), rows, fontsize=label_size)
    axis.set_xlabel("s")
    return colors
