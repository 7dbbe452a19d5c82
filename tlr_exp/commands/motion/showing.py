"""tlr-motion show: a clip as a video, a strip of keyframes, curves; or in a viewer."""

from __future__ import annotations

import argparse
import math
import sys
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.progress import Progress

from tlr_exp.commands.motion.files import CLIP_HELP, ArgumentsError, load_clip, size
from tlr_exp.motion.clip import MotionClip
from tlr_exp.pictures.sizes import size_argument
from tlr_exp.records.outputs import add_force, check_free
from tlr_exp.robot.model import Robot, build_robot
from tlr_exp.viewing import ViewerUnavailable
from tlr_exp.viewing.options import add_viewers, check_port, play, require_viewer, viewer_wanted

PARTS = ("joints", "bodies", "keyframes", "video")
_ENDINGS = {
    "joints": "_joints.png",
    "bodies": "_bodies.png",
    "keyframes": "_keyframes.png",
    "video": ".mp4",
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("clip", metavar="CLIP", help=CLIP_HELP)
    parser.add_argument(
        "-o", "--output", metavar="FOLDER", type=Path, help="by default the clip's name + _pictures"
    )
    add_force(parser, "pictures that exist")
    parser.add_argument(
        "--only", nargs="+", choices=PARTS, default=list(PARTS), help="which pictures"
    )
    parser.add_argument(
        "--fps", type=float, default=25.0, help="frames a second of the video (default: 25)"
    )
    parser.add_argument(
        "--size",
        metavar="WxH",
        type=size_argument,
        default=(480, 360),
        help="of the video, in pixels",
    )
    parser.add_argument("--quality", choices=["fast", "full"], default="fast", help="of the video")
    when = parser.add_mutually_exclusive_group()
    when.add_argument(
        "--columns", type=int, default=8, help="pictures of the strip, evenly spread (default: 8)"
    )
    when.add_argument("--times", metavar="S", type=float, nargs="+", help="or at these times")
    add_viewers(parser.add_mutually_exclusive_group())
    parser.set_defaults(run=_show)


def _show(options: argparse.Namespace) -> int:
    _check(options)
    name = options.clip
    if name.endswith((".npz", ".yaml", ".yml")):
        name = Path(name).stem
    return _watch(options, name) if viewer_wanted(options) else _draw(options, name)


def _check(options: argparse.Namespace) -> None:
    """Refuse what no clip can be shown by, before anything slow is loaded."""
    if options.columns < 1:
        raise ArgumentsError(f"--columns is {options.columns}; it must be at least 1")
    if not 0 < options.fps < math.inf:
        raise ArgumentsError(f"the video's frame rate is {options.fps:g}; it must be positive")
    try:
        check_port(options)
    except ValueError as error:
        raise ArgumentsError(str(error)) from error


def _watch(options: argparse.Namespace, name: str) -> int:
    """0: shown until the viewer was closed, nothing is written; 1: no viewer opens here."""
    from tlr_exp.viewing.recording import recording_of_clip

    try:
        require_viewer(options)
        robot = build_robot(visuals=True)
        clip = load_clip(options.clip, robot)
        play(recording_of_clip(clip, f"{name}: {size(clip)}"), robot, options)
    except ViewerUnavailable as error:
        print(f"tlr-motion: {error}", file=sys.stderr)
        return 1
    return 0


def _draw(options: argparse.Namespace, name: str) -> int:
    """0: all is drawn; 1: this machine has no graphics, only the curves are."""
    # Only here: what draws takes long to import.
    from tlr_exp.pictures.clip_pictures import frames_at

    robot = build_robot(visuals=True)
    clip = load_clip(options.clip, robot)
    times = np.array(options.times or np.linspace(0.0, clip.duration_s, options.columns))
    frames_at(clip, times)
    folder: Path = options.output or Path(f"{name}_pictures")
    paths = {part: folder / f"{name}{_ENDINGS[part]}" for part in PARTS if part in options.only}
    check_free(paths.values(), options.force)
    print(f"{options.clip}: {size(clip)}")
    made = not folder.exists()
    folder.mkdir(exist_ok=True)
    try:
        _plot(name, clip, robot, paths)
        return _render(options, name, clip, robot, paths, times)
    finally:
        if made and not any(folder.iterdir()):
            folder.rmdir()


def _plot(name: str, clip: MotionClip, robot: Robot, paths: dict[str, Path]) -> None:
    from tlr_exp.pictures.clip_plots import body_figure, joint_figure, write_figure

    title = f"{name}: {size(clip)}"
    for part, figure in (("joints", joint_figure), ("bodies", body_figure)):
        if part in paths:
            print(write_figure(paths[part], figure(clip, robot, title)))


def _render(
    options: argparse.Namespace,
    name: str,
    clip: MotionClip,
    robot: Robot,
    paths: dict[str, Path],
    times: np.ndarray,
) -> int:
    from tlr_exp.pictures.clip_pictures import strip_of_clip
    from tlr_exp.pictures.graphics import GraphicsUnavailable

    try:
        if "keyframes" in paths:
            print(strip_of_clip(paths["keyframes"], robot, clip, times))
        if "video" in paths:
            _film(options, name, clip, robot, paths["video"])
    except GraphicsUnavailable as error:
        print(f"tlr-motion: {error}", file=sys.stderr)
        return 1
    return 0


def _film(
    options: argparse.Namespace, name: str, clip: MotionClip, robot: Robot, path: Path
) -> None:
    from tlr_exp.pictures.clip_pictures import film_clip, shown_frames

    (width, height), shown = options.size, shown_frames(clip, options.fps)
    console = Console(stderr=True)
    with Progress(console=console, transient=True, disable=not console.is_terminal) as progress:
        task = progress.add_task(f"{path.name}: drawing {len(shown)} frames", total=len(shown))
        film_clip(
            *(path, robot, clip, name),
            width=width,
            height=height,
            frame_rate_hz=options.fps,
            quality=options.quality,
            drawn=lambda done, _: progress.update(task, completed=done),
        )
    rate = clip.fps / (shown[1] - shown[0])
    print(f"{path}: {len(shown) / rate:.1f} s, {len(shown)} frames at {rate:.3g} fps")
