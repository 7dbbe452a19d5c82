"""tlr-motion check: what is physically wrong with clips, and --fix what can be fixed honestly."""

import argparse
import json
import sys
from dataclasses import asdict
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table
from rich.text import Text

from tlr_exp.commands.motion.files import (
    CLIP_HELP,
    ArgumentsError,
    add_output,
    check_output,
    load_clip,
    size,
)
from tlr_exp.motion.clip import MotionClip
from tlr_exp.motion.quality.check import Finding, check_clip, worst_verdict
from tlr_exp.motion.quality.limits import LIMITS
from tlr_exp.motion.quality.repairs import GROUNDS, repair_clip
from tlr_exp.robot.model import build_robot

_STYLES = {"ok": "green", "note": "cyan", "warn": "yellow", "fail": "bold red"}
_DECIMALS = {"mm": 1, "m/s": 2, "rad": 3, "% of limit": 0, "rad/s²": 0, "m/s²": 1, "s": 2}
_DECIMALS |= {"of gravity": 2}
_WIDTH_WITHOUT_TERMINAL = 140


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("clips", metavar="CLIP", nargs="+", help=CLIP_HELP)
    parser.add_argument("--json", action="store_true", help="print JSON instead of tables")
    parser.add_argument(
        "--fix",
        action="store_true",
        help="write a repaired clip to -o: bad ends cut off, joints at their limits, jumps "
        "smoothed, the lowest point on the floor; then check it",
    )
    parser.add_argument(
        "--ground",
        choices=GROUNDS,
        default="constant",
        help="with --fix: move the whole clip up or down (constant, the default), also remove "
        "slow drift (varying), or keep the height (none)",
    )
    add_output(parser, required=False)
    parser.set_defaults(run=_run)


def _run(
    clips: list[str], json: bool, fix: bool, ground: str, output: Path | None, force: bool
) -> int:
    if not fix:
        if output:
            raise ArgumentsError("-o needs --fix: a check alone writes nothing")
        return _check(clips, json)
    if len(clips) != 1 or output is None:
        raise ArgumentsError("--fix takes one clip and -o CLIP.npz for the result")
    check_output(output, clips, force)
    return _fix(clips[0], output, ground, json)


def _fix(name: str, output: Path, ground: str, as_json: bool) -> int:
    """0 if nothing fails in the repaired clip; else 1, and it is written all the same."""
    robot = build_robot()
    clip = load_clip(name, robot)
    repaired = repair_clip(clip, robot, ground)
    before, after = check_clip(clip, robot), check_clip(repaired.clip, robot)
    repaired.clip.save(output)
    left = [finding.measure for finding in after if finding.verdict in ("warn", "fail")]
    if as_json:
        data = as_data(str(output), repaired.clip, after)
        changes = {"before": as_data(name, clip, before), "changes": repaired.changes}
        print(json.dumps({"clips": [data], **changes}, indent=1))
    else:
        for change in repaired.changes or ["nothing to change"]:
            print(f"{name}: {change}")
        print_findings(str(output), repaired.clip, after)
        if left:
            print(f"Not repaired, since it would have to be invented: {', '.join(left)}")
    return int(worst_verdict(after) == "fail")


def _check(names: list[str], as_json: bool) -> int:
    """0 if nothing fails; 1 if a clip fails or cannot be read (the others are still checked)."""
    robot, results, failed = build_robot(), [], False
    for name in names:
        try:
            clip = load_clip(name, robot)
        except (ValueError, OSError) as error:
            print(f"tlr-motion: {error}", file=sys.stderr)
            results.append({"clip": name, "verdict": "fail", "error": str(error)})
            failed = True
            continue
        findings = check_clip(clip, robot)
        failed |= worst_verdict(findings) == "fail"
        results.append(as_data(name, clip, findings))
        if not as_json:
            print_findings(name, clip, findings)
    if as_json:
        print(json.dumps({"clips": results}, indent=1))
    return int(failed)


def as_data(name: str, clip: MotionClip, findings: list[Finding]) -> dict[str, Any]:
    """The findings of a clip as what JSON can hold."""
    return {
        "clip": name,
        "frames": clip.num_frames,
        "fps": clip.fps,
        "duration_s": clip.duration_s,
        "verdict": worst_verdict(findings),
        "findings": [asdict(finding) for finding in findings],
    }


def print_findings(name: str, clip: MotionClip, findings: list[Finding]) -> None:
    """A table of the findings on standard output."""
    table = Table(title=f"{name}: {size(clip)}", title_justify="left", title_style="bold")
    for column in ("measure", "worst", "where", "right up to", "wrong beyond", "frames", "verdict"):
        table.add_column(column, justify="right" if column == "frames" else "left")
    for finding in findings:
        table.add_row(*_row(finding))
    console = Console(soft_wrap=False, highlight=False)
    if not console.is_terminal:
        console = Console(width=_WIDTH_WITHOUT_TERMINAL, highlight=False)
    console.print(table)


def _row(finding: Finding) -> list[str | Text]:
    where = []
    if round(finding.value, _DECIMALS[finding.unit]) != 0:
        where += [] if finding.time_s is None else [f"{finding.time_s:.2f} s"]
        where += [finding.place] if finding.place else []
    where += [finding.remark] if finding.remark else []
    limit = LIMITS.get(finding.measure)
    sign = "≥ " if limit and limit.at_least else ""
    return [
        finding.measure,
        _number(finding.value, finding.unit),
        ", ".join(where),
        "" if finding.ok is None else sign + _number(finding.ok, finding.unit),
        "" if finding.fail is None else _number(finding.fail, finding.unit),
        str(finding.frames) if finding.frames else "",
        Text(finding.verdict, _STYLES[finding.verdict]),
    ]


def _number(value: float, unit: str) -> str:
    return f"{value:.{_DECIMALS[unit]}f} {unit}"
