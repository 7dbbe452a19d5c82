"""Clips as arguments and as results of tlr-motion."""

import argparse
from collections.abc import Iterable
from pathlib import Path

from tlr_exp.commands.arguments import add_force
from tlr_exp.errors import UserError
from tlr_exp.motion.authoring.keyframes import load_motion
from tlr_exp.motion.clip import MotionClip
from tlr_exp.records.outputs import check_free
from tlr_exp.robot.model import Robot

CLIP_HELP = "an .npz clip, a .yaml of keyframes, or an authored name"


class ArgumentsError(UserError):
    """Arguments that are wrong whatever the files hold; the message says what would be right."""


def load_clip(name: str, robot: Robot) -> MotionClip:
    """A clip by the name of an authored motion, or from a ``.yaml`` or ``.npz`` file.

    Raises:
        FileNotFoundError, ValueError: as ``load_motion``; a motion file of another project is told
            what to do with it.
    """
    try:
        return load_motion(name, robot)
    except ValueError as error:
        foreign = Path(name).is_file() and not name.endswith((".yaml", ".yml"))
        if foreign and (not name.endswith(".npz") or "it lacks" in str(error)):
            raise UserError(
                f"{name} is not a clip; if it is a motion of another project, make a clip of it "
                "with tlr-motion import"
            ) from error
        raise


def add_output(parser: argparse.ArgumentParser, required: bool) -> None:
    """The options -o and --force of a command that writes a clip."""
    parser.add_argument("-o", "--output", metavar="CLIP.npz", type=Path, required=required)
    add_force(parser, "CLIP.npz if it exists")


def check_output(output: Path, inputs: Iterable[str | Path], force: bool) -> None:
    """Refuse a place to which no clip may be written, before minutes of work.

    Raises:
        ArgumentsError: not an ``.npz``.
        UserError: no folder, or one of the inputs.
        FileExistsError: something is there, and ``force`` is not given.
    """
    if output.suffix != ".npz":
        raise ArgumentsError(f"{output}: the name of a clip must end in .npz")
    if not output.parent.is_dir():
        raise UserError(f"{output}: there is no folder {output.parent}")
    for path in map(Path, inputs):
        if output.exists() and path.exists() and output.samefile(path):
            raise UserError(f"{output}: the clip would replace the file it is made from")
    check_free([output], force)


def size(clip: MotionClip) -> str:
    """Frames, rate and duration in words."""
    return f"{clip.num_frames} frames at {clip.fps:g} fps, {clip.duration_s:.2f} s"
