"""tlr-motion join: clips one after the other, as one."""

import argparse
from pathlib import Path

import numpy as np

from tlr_exp.commands.motion.checking import print_findings
from tlr_exp.commands.motion.files import (
    CLIP_HELP,
    ArgumentsError,
    add_output,
    check_output,
    load_clip,
)
from tlr_exp.motion.quality.check import check_clip, worst_verdict
from tlr_exp.motion.quality.joining import BLEND_S, Seam, join_clips
from tlr_exp.robot.model import build_robot


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("clips", metavar="CLIP", nargs="+", help=CLIP_HELP)
    parser.add_argument(
        "--blend",
        metavar="SECONDS",
        type=float,
        default=BLEND_S,
        help="time over which a clip takes over from the pose and speed in which the previous one "
        f"ends (default: {BLEND_S:g})",
    )
    add_output(parser, required=True)
    parser.set_defaults(run=_join)


def _join(clips: list[str], blend: float, output: Path, force: bool) -> int:
    """0 if nothing fails in the joined clip; else 1, and it is written all the same."""
    if len(clips) < 2:
        raise ArgumentsError("joining needs at least two clips")
    check_output(output, clips, force)
    robot = build_robot()
    loaded = [load_clip(name, robot) for name in clips]
    joined, seams = join_clips(loaded, robot, blend)
    findings = check_clip(joined, robot)
    joined.save(output)
    for name, clip, seam in zip(clips[1:], loaded[1:], seams, strict=True):
        if clip.fps != joined.fps:
            print(f"{name}: resampled from {clip.fps:g} to {joined.fps:g} fps")
        print(f"{name}: {described(seam, blend)}")
    print_findings(str(output), joined, findings)
    return int(worst_verdict(findings) == "fail")


def described(seam: Seam, blend_s: float) -> str:
    """A seam in words."""
    x, y = seam.moved_m
    text = (
        f"begins at {seam.time_s:.2f} s, turned by {np.degrees(seam.turned_rad):.1f}° and moved by "
        f"({x:.3f}, {y:.3f}) m; blended over {blend_s:g} s: "
        f"height {1000 * seam.height_gap_m:+.1f} mm, tilt {np.degrees(seam.tilt_gap_rad):.1f}°, "
        f"joints up to {seam.joint_gap_rad:.3f} rad ({seam.joint})"
    )
    if seam.clamped_rad > 0:
        text += f"; joints up to {seam.clamped_rad:.3f} rad beyond their limits set to them"
    return text
