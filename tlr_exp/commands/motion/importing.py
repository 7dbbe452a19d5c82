"""tlr-motion import: a clip from a motion file of another project."""

import argparse
from pathlib import Path
from typing import Any

from tlr_exp.commands.motion.files import add_output, check_output, size
from tlr_exp.motion.importers.convert import CLAMP_RAD, Imported, import_motion
from tlr_exp.motion.importers.detect import READERS
from tlr_exp.motion.importers.raw import Options
from tlr_exp.motion.importers.readings.conventions import CHOICES
from tlr_exp.robot.model import build_robot

# Beyond this the file was made for another body: other link lengths, joints or quaternions.
LARGE_GAP_M = 0.02
# The reference is read one frame ahead (env.reference_lead), and an episode has at least one step.
FRAMES_TO_TRAIN = 3


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("file", metavar="FILE", type=Path)
    add_output(parser, required=True)
    parser.add_argument(
        "--format", choices=list(READERS), help="default: recognised from the file's content"
    )
    parser.add_argument("--motion", metavar="NAME", help="which motion, if the file holds several")
    parser.add_argument(
        "--fps", type=float, help="rate of the file, if it is not what the file says"
    )
    parser.add_argument(
        "--joint-order",
        choices=CHOICES["joint_order"],
        help="for a file without joint names (default: recognised from its body positions, or as "
        "usual in the format)",
    )
    parser.add_argument("--units", choices=CHOICES["units"], help="unit of positions")
    parser.add_argument(
        "--quaternion", choices=CHOICES["quaternion"], help="order of the four components"
    )
    parser.add_argument("--up", choices=CHOICES["up"], help="the axis that points up")
    parser.add_argument("--angles", choices=CHOICES["angles"], help="unit of joint angles")
    parser.add_argument(
        "--anyway",
        action="store_true",
        help="import a motion even if it does not look like a robot on a floor, or if another "
        "reading makes more sense",
    )
    parser.add_argument(
        "--clamp",
        metavar="RAD",
        type=float,
        default=CLAMP_RAD,
        help=f"how far a joint may exceed its limit and be set to it (default: {CLAMP_RAD:g})",
    )
    parser.set_defaults(run=_import)


def _import(
    file: Path, output: Path, force: bool, format: str | None, clamp: float, **reading: Any
) -> None:
    check_output(output, [file], force)
    imported = import_motion(file, build_robot(), format, Options(**reading), clamp)
    imported.clip.save(output)
    for line in report(file, imported):
        print(line)
    print(f"{output}: {size(imported.clip)}")
    if imported.clip.num_frames < FRAMES_TO_TRAIN:
        print(
            f"  WARNING: this motion is too short to train on: a training needs at least "
            f"{FRAMES_TO_TRAIN} frames at {imported.clip.fps:g} fps"
        )


def report(path: Path, imported: Imported) -> list[str]:
    """What an import found and changed, as lines of text."""
    raw, gap = imported.raw, imported.gap
    order = f", joints in the order of {raw.joint_order}" if raw.joint_order else ""
    lines = [f"{path}: {imported.format}, {len(raw.qpos)} frames at {raw.fps:g} fps{order}"]
    lines += [f"  {note}" for note in raw.notes]
    for clamp in imported.clamps:
        lines.append(
            f"  {clamp.joint}: up to {clamp.excess_rad:.3f} rad beyond its limit in "
            f"{clamp.frames} frames, set to the limit"
        )
    if gap is None:
        lines.append("  forward kinematics: not compared, the file has no body positions")
        return lines
    lines.append(
        f"  forward kinematics: the file's body positions differ by {gap.mean_m * 1000:.1f} mm on "
        f"average, {gap.max_m * 1000:.1f} mm at most ({gap.body}, frame {gap.frame})"
    )
    if gap.max_m > LARGE_GAP_M:
        lines.append("  WARNING: such a difference means another robot model or a wrong reading")
    return lines
