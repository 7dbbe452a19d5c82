"""Clips as arguments and as results of tlr-motion."""

from __future__ import annotations

import argparse
from collections.abc import Iterable
from pathlib import Path

from tlr_exp.motion.clip import MotionClip

CLIP_HELP = "an .npz clip, a .yaml of keyframes, or an authored name"


def add_output(parser: argparse.ArgumentParser, required: bool) -> None:
    """The options -o and --force of a command that writes a clip."""
    parser.add_argument("-o", "--output", metavar="CLIP.npz", type=Path, required=required)
    parser.add_argument("--force", action="store_true", help="replace CLIP.npz if it exists")


def check_output(output: Path, inputs: Iterable[str | Path], force: bool) -> None:
    """Refuse a place to which no clip may be written, before minutes of work.

    Raises:
        ValueError: not an ``.npz``, no folder, or one of the inputs.
        FileExistsError: something is there, and ``force`` is not given.
    """
    if output.suffix != ".npz":
        raise ValueError(f"{output}: the name of a clip must end in .npz")
    if not output.parent.is_dir():
        raise ValueError(f"{output}: there is no folder {output.parent}")
    for path in map(Path, inputs):
        if output.exists() and path.exists() and output.samefile(path):
            raise ValueError(f"{output}: the clip would replace the file it is made from")
    if output.exists() and not force:
        raise FileExistsError(f"{output} exists; --force replaces it")


def size(clip: MotionClip) -> str:
    """Frames, rate and duration in words."""
    return f"{clip.num_frames} frames at {clip.fps:g} fps, {clip.duration_s:.2f} s"
