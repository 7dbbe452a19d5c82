"""tlr-motion show: a clip as a video, a strip of keyframes, curves of joints and bodies."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.progress import Progress

from tlr_exp.motion.clip import MotionClip
from tlr_exp.motion_tool.files import CLIP_HELP, load_clip, size
from tlr_exp.pictures.sizes import size_argument
from tlr_exp.robot import Robot, build_robot

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
    parser.add_argument("--force", action="store_true", help="replace pictures that exist")
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
    parser.set_defaults(run=_show)


def _show(options: argparse.Namespace) -> int:
    """0: all is drawn; 1: this machine has no graphics, only the curves are."""
    # Only here: what draws takes long to import.
    from tlr_exp.pictures.clip_pictures import frames_at, shown_frames

    name = options.clip
    if name.endswith((".npz", ".yaml", ".yml")):
        name = Path(name).stem
    robot = build_robot(visuals=True)
    clip = load_clip(options.clip, robot)
    shown_frames(clip, options.fps)
    if options.columns < 1:
        raise ValueError(f"--columns is {options.columns}; it must be at least 1")
    times = np.array(options.times or np.linspace(0.0, clip.duration_s, options.columns))
    frames_at(clip, times)
    folder: Path = options.output or Path(f"{name}_pictures")
    paths = {part: folder / f"{name}{_ENDINGS[part]}" for part in PARTS if part in options.only}
    existing = [path for path in paths.values() if path.exists()]
    if existing and not options.force:
        raise FileExistsError(f"{existing[0]} exists; --force replaces it")
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
