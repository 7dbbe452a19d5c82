"""tlr-motion show: a clip as a video, a strip of keyframes, curves; or in a viewer."""

from __future__ import annotations

import argparse
import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from rich.console import Console
from rich.progress import Progress

from tlr_exp.commands.arguments import (
    add_force,
    add_viewers,
    drawn_as,
    size_argument,
    viewer_of,
)
from tlr_exp.commands.motion.files import CLIP_HELP, ArgumentsError, load_clip, size
from tlr_exp.errors import UserError
from tlr_exp.motion.clip import MotionClip
from tlr_exp.records.outputs import check_free
from tlr_exp.robot.model import Robot, build_robot
from tlr_exp.viewing.viewer import Viewer

if TYPE_CHECKING:
    from tlr_exp.pictures.recording import Recording

# What is drawn, and how the names of the files end.
PARTS = {
    "joints": "_joints.png",
    "bodies": "_bodies.png",
    "keyframes": "_keyframes.png",
    "video": ".mp4",
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("clip", metavar="CLIP", help=CLIP_HELP)
    parser.add_argument(
        "-o", "--output", metavar="FOLDER", type=Path, help="default: the clip's name + _pictures"
    )
    add_force(parser, "existing pictures")
    parser.add_argument(
        "--only", nargs="+", choices=PARTS, default=list(PARTS), help="make only these"
    )
    parser.add_argument(
        "--fps", type=float, default=25.0, help="frames per second of the video (default: 25)"
    )
    parser.add_argument(
        "--size",
        metavar="WxH",
        type=size_argument,
        default=(480, 360),
        help="size of the video in pixels",
    )
    parser.add_argument("--quality", choices=["fast", "full"], default="fast", help="of the video")
    when = parser.add_mutually_exclusive_group()
    when.add_argument(
        "--columns", type=int, default=8, help="evenly spaced pictures in the strip (default: 8)"
    )
    when.add_argument("--times", metavar="S", type=float, nargs="+", help="or at these times")
    add_viewers(parser.add_mutually_exclusive_group())
    parser.set_defaults(run=_show)


def _show(
    clip: str,
    output: Path | None,
    force: bool,
    only: list[str],
    fps: float,
    size: tuple[int, int],
    quality: str,
    columns: int,
    times: list[float] | None,
    view: bool,
    web: int | None,
) -> None:
    if columns < 1:
        raise ArgumentsError(f"--columns is {columns}; it must be at least 1")
    if not 0 < fps < math.inf:
        raise ArgumentsError(f"the video's frame rate is {fps:g}; it must be positive")
    try:
        viewer = viewer_of(view, web)
    except UserError as error:
        raise ArgumentsError(str(error)) from error
    name = Path(clip).stem if clip.endswith((".npz", ".yaml", ".yml")) else clip
    if viewer is not None:
        _watch(clip, name, viewer)
        return
    folder = output or Path(f"{name}_pictures")
    paths = {part: folder / f"{name}{end}" for part, end in PARTS.items() if part in only}
    video = {"frame_rate_hz": fps, **drawn_as(size, quality)}
    _draw(clip, name, paths, times or columns, video, force)


def _watch(clip: str, name: str, viewer: Viewer) -> None:
    """Show it until the viewer is closed; nothing is written.

    Raises:
        ViewerUnavailable: no viewer opens here.
    """
    from tlr_exp.pictures.recording import recording_of_clip

    viewer.require()
    robot = build_robot(visuals=True)
    loaded = load_clip(clip, robot)
    viewer.play(recording_of_clip(loaded, f"{name}: {size(loaded)}"), robot)


def _draw(
    name_of_clip: str,
    name: str,
    paths: dict[str, Path],
    moments: list[float] | int,
    video: dict[str, Any],
    force: bool,
) -> None:
    """Draw the curves, then what needs graphics.

    ``moments``: the times of the strip's pictures in s, or how many are evenly spread; ``video``:
    as ``film`` takes them.

    Raises:
        GraphicsUnavailable: this machine has none; the curves are drawn.
    """
    # Only here: what draws takes long to import.
    from tlr_exp.pictures.recording import recording_of_clip

    robot = build_robot(visuals=True)
    clip = load_clip(name_of_clip, robot)
    recording = recording_of_clip(clip, f"{name}: {size(clip)}")
    if isinstance(moments, int):
        moments = list(np.linspace(0.0, clip.duration_s, moments))
    keyframes = recording.frames_at(np.array(moments))
    check_free(paths.values(), force)
    print(f"{name_of_clip}: {size(clip)}")
    folder = next(iter(paths.values())).parent
    made = not folder.exists()
    folder.mkdir(exist_ok=True)
    try:
        _plot(clip, robot, recording.title, paths)
        _render(recording, robot, name, paths, keyframes, video)
    finally:
        if made and not any(folder.iterdir()):
            folder.rmdir()


def _plot(clip: MotionClip, robot: Robot, title: str, paths: dict[str, Path]) -> None:
    from tlr_exp.pictures.media import write_figure
    from tlr_exp.pictures.plots import body_figure, joint_figure

    for part, figure in (("joints", joint_figure), ("bodies", body_figure)):
        if part in paths:
            print(write_figure(paths[part], figure(clip, robot, title)))


def _render(
    recording: Recording,
    robot: Robot,
    name: str,
    paths: dict[str, Path],
    keyframes: np.ndarray,
    video: dict[str, Any],
) -> None:
    from tlr_exp.pictures.media import write_image
    from tlr_exp.pictures.strips import keyframe_strip

    if "keyframes" in paths:
        strip = keyframe_strip(robot, recording, keyframes)
        print(write_image(paths["keyframes"], strip))
    if "video" in paths:
        _film(paths["video"], robot, recording, name, video)


def _film(path: Path, robot: Robot, recording: Recording, name: str, video: dict[str, Any]) -> None:
    from tlr_exp.pictures.film import film

    shown = recording.frames_at_rate(video["frame_rate_hz"])
    rate = recording.rate_of(shown)
    console = Console(stderr=True)
    with Progress(console=console, transient=True, disable=not console.is_terminal) as progress:
        task = progress.add_task(f"{path.name}: drawing {len(shown)} frames", total=len(shown))
        film(
            *(path, robot, recording),
            heading=name,
            drawn=lambda done: progress.update(task, completed=done),
            **video,
        )
    print(f"{path}: {len(shown) / rate:.1f} s, {len(shown)} frames at {rate:.3g} fps")
