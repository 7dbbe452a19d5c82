"""Strips of pictures: a recording moment by moment; policies below their reference.

The latter as in the paper's Figures 9 to 12.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from tlr_exp.errors import UserError
from tlr_exp.evaluation.distances import body_distance, tilt
from tlr_exp.evaluation.result import EvaluationResult
from tlr_exp.evaluation.trajectory import Trajectory
from tlr_exp.motion.checks import same_motion
from tlr_exp.pictures.framing import camera_for, camera_path, frame_robots
from tlr_exp.pictures.recording import Recording
from tlr_exp.pictures.render import render_frames
from tlr_exp.robot.model import Robot

_INK, _GREY, _RED, _PAPER = (25, 30, 40), (95, 100, 110), (190, 30, 30), (255, 255, 255)
_REFERENCE = "reference"


def keyframe_strip(
    robot: Robot,
    recording: Recording,
    frames: np.ndarray,
    *,
    width: int = 320,
    height: int = 400,
    quality: str = "full",
) -> np.ndarray:
    """Pictures of some states side by side, each with its time above.

    Args:
        robot: from ``build_robot(visuals=True)``.
        recording: the states, without a reference.
        frames: which of them [n].
        width, height: of one picture, pixels.
        quality: as ``render_frames``.

    Returns:
        uint8 [height, width, 3] of the whole strip.

    Raises:
        GraphicsUnavailable, ValueError: as ``render_frames``.
    """
    # A picture of its own stands still: what is in the middle of it is the pelvis.
    lookat = np.column_stack([recording.qpos[:, :2], camera_path(recording)[:, 2]])
    camera, lookat = camera_for(recording, lookat, frames, width / height)
    pictures = render_frames(
        robot,
        recording.qpos[frames],
        width=width,
        height=height,
        camera=camera,
        lookat=lookat,
        quality=quality,
    )
    strip = np.concatenate(list(pictures), axis=1)
    size = max(10, height // 20)
    page = Image.new("RGB", (strip.shape[1], 2 * size + height), _PAPER)
    page.paste(Image.fromarray(strip), (0, 2 * size))
    draw, font = ImageDraw.Draw(page), ImageFont.load_default(size)
    for column, frame in enumerate(frames):
        label = f"{frame * recording.dt_s:.2f} s"
        draw.text(((column + 0.5) * width, size), label, _INK, font, anchor="mm")
    return np.asarray(page)


@dataclass(frozen=True)
class StripRow:
    """One policy: its label (may have several lines), its roll-out, and what was measured.

    ``max_tilt``: a larger ``tilt`` is a fall, as in ``evaluate_trajectory``.
    """

    label: str
    trajectory: Trajectory
    result: EvaluationResult
    max_tilt: float

    @property
    def first_fall(self) -> int | None:
        """The step at which the robot fell; None where it stayed upright."""
        trajectory = self.trajectory
        fallen = (tilt(trajectory.qpos[:, 3:7]) > self.max_tilt) | trajectory.unstable
        return int(np.argmax(fallen)) if fallen.any() else None


def policy_strip(
    robot: Robot,
    rows: Sequence[StripRow],
    *,
    title: str = "",
    columns: int = 8,
    width: int = 320,
    height: int = 400,
    quality: str = "full",
) -> np.ndarray:
    """Draw the reference above the policies, a column for each of ``columns`` even moments.

    All rows of a column are seen by the same camera, which looks at the reference's pelvis. In each
    picture of a policy is its mean distance from the reference at that moment, over all bodies;
    where the robot has fallen that is written in red.

    Args:
        robot: from ``build_robot(visuals=True)``.
        rows: policies with one reference.
        title: written above.
        columns: as many as the motion has steps at most.
        width, height: of one picture, pixels.
        quality: as ``render_frames``.

    Returns:
        uint8 [height, width, 3] of the whole table.

    Raises:
        ValueError: no row, references that differ, too many columns.
        GraphicsUnavailable: nothing can be drawn on this machine.
    """
    _check(rows, columns)
    steps = moments(rows[0].trajectory.num_steps, columns)
    pictures = _pictures(robot, rows, steps, width, height, quality)
    page = _Page(rows, columns, width, height, bool(title))
    page.head(title, rows[0].trajectory, steps)
    page.reference(pictures[0])
    for index, row in enumerate(rows, start=1):
        page.row(index, row, steps, pictures[index])
    return np.asarray(page.image)


def moments(num_steps: int, columns: int) -> np.ndarray:
    """The steps [columns] that a strip shows: evenly spread, the first and the last among them."""
    return np.rint(np.linspace(0, num_steps - 1, columns)).astype(int)


def strip_lookat(reference_qpos: np.ndarray) -> np.ndarray:
    """Where the camera looks [n, 3], m: the pelvis over the floor, at one height for all."""
    lookat = reference_qpos[:, :3].copy()
    lookat[:, 2] = reference_qpos[:, 2].mean()
    return lookat


def _pictures(
    robot: Robot, rows: Sequence[StripRow], steps: np.ndarray, width: int, height: int, quality: str
) -> np.ndarray:
    """uint8 [rows + 1, columns, height, width, 3], the reference first."""
    first = rows[0].trajectory
    reference = first.reference_qpos[steps]
    lookat = strip_lookat(reference)
    bodies = [first.reference_body_pos_w[steps], *(r.trajectory.body_pos_w[steps] for r in rows)]
    camera, lookat = frame_robots(bodies, lookat, reference[0], width / height)
    # All in one go: the camera's direction is relative to the robot's in the first picture.
    qpos = np.concatenate([reference, *(row.trajectory.qpos[steps] for row in rows)])
    frames = render_frames(
        robot,
        qpos,
        width=width,
        height=height,
        camera=camera,
        lookat=np.tile(lookat, (len(rows) + 1, 1)),
        quality=quality,
    )
    return np.stack(list(frames)).reshape(len(rows) + 1, len(steps), height, width, 3)


def _check(rows: Sequence[StripRow], columns: int) -> None:
    if not rows:
        raise UserError("a strip needs at least one policy")
    first = rows[0].trajectory
    for row in rows[1:]:
        if not same_motion(row.trajectory.reference_qpos, first.reference_qpos):
            raise UserError(f"{row.label!r} and {rows[0].label!r} have different references")
    if not 1 <= columns <= first.num_steps:
        raise UserError(f"columns is {columns}; the motion has 1 to {first.num_steps} moments")


class _Page:
    """The white page that pictures and labels are put on."""

    def __init__(
        self, rows: Sequence[StripRow], columns: int, width: int, height: int, titled: bool
    ) -> None:
        self.width, self.height = width, height
        size = max(12, height // 20)
        self.large, self.small = ImageFont.load_default(1.2 * size), ImageFont.load_default(size)
        self.line = round(1.35 * size)
        self.gap = max(2, height // 130)
        texts = [(_REFERENCE, ""), *((row.label, _measured(row)) for row in rows)]
        names = [line for label, _ in texts for line in label.split("\n")]
        numbers = [line for _, text in texts for line in text.split("\n")]
        widest = max(
            *(self.large.getlength(name) for name in names),
            *(self.small.getlength(number) for number in numbers),
        )
        self.left = round(widest) + 2 * self.line
        self.title = round(1.8 * self.line) if titled else 0
        self.top = self.title + round(2.4 * self.line)
        right = self.left + columns * (width + self.gap)
        bottom = self.top + (len(rows) + 1) * (height + self.gap)
        self.image = Image.new("RGB", (right, bottom), _PAPER)
        self.draw = ImageDraw.Draw(self.image)

    def head(self, title: str, trajectory: Trajectory, steps: np.ndarray) -> None:
        """Title, and phase and time over each column."""
        if title:
            place = (self.line // 2, self.title / 2 + self.gap)
            self.draw.text(place, title, _INK, self.large, anchor="lm")
        for column, step in enumerate(steps):
            middle = self._corner(0, column)[0] + self.width / 2
            phase = f"phase {(step + 1) / trajectory.num_steps:.2f}"
            time = f"{(step + 1) * trajectory.control_dt_s:.2f} s"
            self.draw.text((middle, self.title + self.line), phase, _INK, self.small, "ms")
            self.draw.text((middle, self.title + 2 * self.line), time, _GREY, self.small, "ms")

    def reference(self, pictures: np.ndarray) -> None:
        """The first row."""
        self._label(0, _REFERENCE, "")
        self._paste(0, pictures)

    def row(self, index: int, row: StripRow, steps: np.ndarray, pictures: np.ndarray) -> None:
        """A policy's row."""
        self._label(index, row.label, _measured(row))
        self._paste(index, pictures)
        trajectory, fall = row.trajectory, row.first_fall
        distance = body_distance(trajectory.body_pos_w, trajectory.reference_body_pos_w)
        for column, step in enumerate(steps):
            x, y = self._corner(index, column)
            place = (x + self.line // 2, y + self.height - self.line // 2)
            text, colour = f"{distance[step].mean():.2f} m", _INK
            if fall is not None and step >= fall:
                text, colour = f"fallen, {text}", _RED
                box = (x, y, x + self.width - 1, y + self.height - 1)
                self.draw.rectangle(box, outline=_RED, width=self.gap)
            self.draw.text(place, text, colour, self.small, anchor="ls")

    def _paste(self, index: int, pictures: np.ndarray) -> None:
        for column, picture in enumerate(pictures):
            self.image.paste(Image.fromarray(picture), self._corner(index, column))

    def _label(self, index: int, label: str, measured: str) -> None:
        names, numbers = label.split("\n"), measured.split("\n") if measured else []
        height = self.line * (1.2 * len(names) + len(numbers))
        y = self._corner(index, 0)[1] + (self.height - height) / 2 + self.line
        for line in names:
            self.draw.text((self.left / 2, y), line, _INK, self.large, anchor="ms")
            y += 1.2 * self.line
        for line in numbers:
            self.draw.text((self.left / 2, y), line, _GREY, self.small, anchor="ms")
            y += self.line

    def _corner(self, row: int, column: int) -> tuple[int, int]:
        x = self.left + column * (self.width + self.gap)
        return x, self.top + row * (self.height + self.gap)


def _measured(row: StripRow) -> str:
    """The row's errors over the whole motion, and how long it stayed up, one a line."""
    result, fall = row.result, row.first_fall
    seconds = None if fall is None else (fall + 1) * row.trajectory.control_dt_s
    return "\n".join(
        [
            f"upper body {result.upper_body_error_m:.3f} m",
            f"lower body {result.lower_body_error_m:.3f} m",
            "upright to the end" if seconds is None else f"fell at {seconds:.2f} s",
        ]
    )
