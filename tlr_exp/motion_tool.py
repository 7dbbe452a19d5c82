"""tlr-motion: bring motions of other projects in, and look at clips."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from tlr_exp.g1 import JOINT_NAMES
from tlr_exp.motion.checks import ROOT_QUAT
from tlr_exp.motion.clip import MotionClip, kinematics_error
from tlr_exp.motion.clips import motion_names
from tlr_exp.motion.importers.convert import CLAMP_RAD, Imported, import_motion
from tlr_exp.motion.importers.detect import READERS
from tlr_exp.motion.importers.raw import Options
from tlr_exp.motion.keyframes import load_motion
from tlr_exp.motion.quaternions import angle_between
from tlr_exp.robot import build_robot

if TYPE_CHECKING:
    from tlr_exp.robot import Robot

# Beyond this the file was made for another body: other link lengths, joints or quaternions.
LARGE_GAP_M = 0.02


def main(arguments: Sequence[str] | None = None) -> int:
    """Entry point. 0: done; 1: a file was refused, nothing was written; 2: wrong arguments."""
    options = _parser().parse_args(arguments)
    try:
        options.run(options)
    except (ValueError, OSError) as error:
        print(f"tlr-motion: {error}", file=sys.stderr)
        return 1
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="tlr-motion", description="Bring motions in from other projects, and look at clips."
    )
    commands = parser.add_subparsers(required=True, metavar="COMMAND")
    _add_import(commands.add_parser("import", help="make a clip from a motion file"))
    info = commands.add_parser("info", help="what a clip holds")
    info.add_argument("clip", metavar="CLIP", help="an .npz clip, a .yaml, or an authored name")
    info.set_defaults(run=_info)
    names = commands.add_parser("list", help="the authored motions")
    names.set_defaults(run=_list)
    return parser


def _add_import(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("file", metavar="FILE", type=Path)
    parser.add_argument("-o", "--output", metavar="CLIP.npz", type=Path, required=True)
    parser.add_argument(
        "--format", choices=list(READERS), help="by default told from the file's content"
    )
    parser.add_argument("--force", action="store_true", help="replace CLIP.npz if it exists")
    parser.add_argument("--motion", metavar="NAME", help="which motion, where a file holds several")
    parser.add_argument(
        "--fps", type=float, help="rate of the file, where it is not what the file says"
    )
    parser.add_argument(
        "--joint-order",
        choices=["mujoco", "isaac"],
        help="of an .npz without joint names; by default told from its body positions",
    )
    parser.add_argument(
        "--clamp",
        metavar="RAD",
        type=float,
        default=CLAMP_RAD,
        help="how far beyond its limit a joint may be, to be set to the limit (default: "
        f"{CLAMP_RAD:g})",
    )
    parser.set_defaults(run=_import)


def _import(options: argparse.Namespace) -> None:
    output: Path = options.output
    if output.suffix != ".npz":
        raise ValueError(f"{output}: the name of a clip must end in .npz")
    if not output.parent.is_dir():
        raise ValueError(f"{output}: there is no folder {output.parent}")
    if output.exists() and options.file.exists() and output.samefile(options.file):
        raise ValueError(f"{output}: the clip would replace the file it is made from")
    if output.exists() and not options.force:
        raise FileExistsError(f"{output} exists; --force replaces it")
    asked = Options(options.motion, options.fps, options.joint_order)
    imported = import_motion(options.file, build_robot(), options.format, asked, options.clamp)
    imported.clip.save(output)
    for line in report(options.file, imported):
        print(line)
    print(f"{output}: {_size(imported.clip)}")


def report(path: Path, imported: Imported) -> list[str]:
    """What an import found and changed, as lines of text."""
    raw, gap = imported.raw, imported.gap
    order = f", joints in the order of {raw.joint_order}" if raw.joint_order else ""
    lines = [f"{path}: {imported.format}, {len(raw.qpos)} frames at {raw.fps:g} fps{order}"]
    for clamp in imported.clamps:
        lines.append(
            f"  {clamp.joint}: up to {clamp.excess_rad:.3f} rad beyond its limit in "
            f"{clamp.frames} frames, set to the limit"
        )
    if gap is None:
        lines.append("  forward kinematics: not compared, the file carries no body positions")
        return lines
    lines.append(
        f"  forward kinematics: the file's body positions differ by {gap.mean_m * 1000:.1f} mm on "
        f"average, {gap.max_m * 1000:.1f} mm at most ({gap.body}, frame {gap.frame})"
    )
    if gap.max_m > LARGE_GAP_M:
        lines.append("  WARNING: that much means another robot model, or a wrong reading")
    return lines


def _info(options: argparse.Namespace) -> None:
    robot = build_robot()
    clip = load_motion(options.clip, robot)
    print(f"{options.clip}: {_size(clip)}")
    for line in _measures(clip, robot):
        print(f"  {line}")


def _measures(clip: MotionClip, robot: Robot) -> list[str]:
    root = clip.qpos[:, :3]
    travel = float(np.linalg.norm(np.diff(root[:, :2], axis=0), axis=1).sum())
    turn = angle_between(clip.qpos[:1, ROOT_QUAT], clip.qpos[:, ROOT_QUAT]).max()
    speed = np.abs(clip.qvel[:, 6:]) / robot.velocity_limit_rad_s
    fastest = int(speed.max(axis=0).argmax())
    position, angle = kinematics_error(clip, robot)
    return [
        f"pelvis: height {root[:, 2].min():.3f} to {root[:, 2].max():.3f} m, path {travel:.2f} m, "
        f"turned from the start by at most {np.degrees(turn):.0f} degrees",
        f"lowest body origin: {clip.body_pos_w[..., 2].min():.3f} m",
        f"fastest joint: {JOINT_NAMES[fastest]}, {100 * speed.max():.0f} % of its speed limit",
        f"forward kinematics: bodies differ by at most {position * 1000:.3f} mm and "
        f"{np.degrees(angle):.3f} degrees",
    ]


def _size(clip: MotionClip) -> str:
    return f"{clip.num_frames} frames at {clip.fps:g} fps, {clip.duration_s:.2f} s"


def _list(options: argparse.Namespace) -> None:
    for name in motion_names():
        print(name)


if __name__ == "__main__":
    sys.exit(main())
