"""Curves of a clip: every joint within its limits; heights and speeds of the bodies."""

import io
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from tlr_exp.motion.checks import QPOS_JOINTS
from tlr_exp.motion.clip import MotionClip
from tlr_exp.motion.quality.floor import FloorContacts, floor_contacts, stretches
from tlr_exp.records.storage import atomic_write
from tlr_exp.robot.model import Robot
from tlr_exp.robot.spec import SIDES, RobotSpec

# Okabe and Ito's colours, which colour-blind readers tell apart.
LEFT, RIGHT, MIDDLE, LIMIT, FLIGHT = "#0072B2", "#D55E00", "#333333", "#CC3311", "#F0E442"
DPI = 110
_COLORS = {"left": LEFT, "right": RIGHT, "": MIDDLE}  # by the side of a joint
# The left is broad and light, so that it shows where the right lies on it.
_LINES = {
    LEFT: {"color": LEFT, "linewidth": 2.8, "alpha": 0.5},
    RIGHT: {"color": RIGHT, "linewidth": 1.1},
    MIDDLE: {"color": MIDDLE, "linewidth": 1.2},
}


def joint_figure(clip: MotionClip, robot: Robot, title: str) -> Figure:
    """Positions and velocities of the joints, left and right in one panel.

    What is beyond a joint's limits is shaded; where a limit is out of sight it is written in.
    Roll and yaw joints of the right side change sign, so that both sides have the same limits.
    """
    figure = Figure(figsize=(19, 9), layout="constrained")
    figure.suptitle(title)
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
    figure = Figure(figsize=(12, 11), layout="constrained")
    figure.suptitle(title)
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
    names = [name.removesuffix("_link") for name in robot.spec.tracked_bodies]
    extent = (-0.5 / clip.fps, time[-1] + 0.5 / clip.fps, len(names) - 0.5, -0.5)
    colors = image.imshow(
        speeds.T, aspect="auto", cmap="viridis", extent=extent, vmin=0.0, interpolation="nearest"
    )
    image.set_yticks(range(len(names)), names)
    image.tick_params(axis="y", labelsize=7)
    image.set_xlabel("s")
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


def write_figure(path: str | Path, figure: Figure) -> Path:
    """Write a figure as a PNG, whole or not at all.

    Raises:
        StorageError: a full disk, a read-only folder, ...
    """
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=DPI)
    atomic_write(Path(path), buffer.getbuffer())
    return Path(path)
