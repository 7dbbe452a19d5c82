"""Policies of several runs below their reference, one strip for each checkpoint."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tlr_exp.assembly.world import build_clip, build_robot_of
from tlr_exp.commands.evaluate.strip_rows import row_of
from tlr_exp.errors import UserError
from tlr_exp.evaluation.choosing import Choice, choose
from tlr_exp.evaluation.policies import evaluate
from tlr_exp.motion.checks import same_motion
from tlr_exp.pictures.graphics import graphics_backend
from tlr_exp.pictures.media import write_image
from tlr_exp.pictures.strips import policy_strip
from tlr_exp.records.checkpoint_files import BEST, CHECKPOINTS, LAST, checkpoint_iterations
from tlr_exp.records.outputs import check_free
from tlr_exp.records.run_directory import RunDirectory

PAPER_SHARES = (4.0, 20.0, 40.0, 88.0)  # Figures 9-12: iterations 100, 500, 1000, 2200 of 2500


@dataclass(frozen=True)
class Checkpoints:
    """Which checkpoints are compared, at most one of the last three; and the engine, if another."""

    physics: str | None = None
    name: str | None = None  # best, last or an iteration
    iterations: Sequence[int] | None = None
    shares: Sequence[float] | None = None  # % of each training


@dataclass(frozen=True)
class Moment:
    """One moment of the trainings: how it is called, and each run's checkpoint at it."""

    suffix: str  # of the file's name
    choices: tuple[Choice, ...]


def compare(
    runs: Sequence[Path], which: Checkpoints, output: Path | None, force: bool, **look: Any
) -> None:
    """``tlr-evaluate RUN … --strip``; ``look``: columns, size and quality as ``policy_strip``'s.

    Raises:
        ValueError: a run has no such checkpoint, or the runs are not of one motion and robot.
        FileExistsError: a strip is there already, and --force is not given.
        GraphicsUnavailable: nothing can be drawn on this machine.
    """
    path = output or Path("strip.png")
    if path.suffix.lower() != ".png":
        raise UserError(f"--strip writes a PNG: -o {path} should end in .png")
    if not path.absolute().parent.is_dir():
        raise UserError(f"-o {path}: there is no folder {path.absolute().parent}")
    moments = find_moments(runs, which)
    files = strip_paths(path, moments)
    check_free(files, force)
    check_one_motion(moments[0].choices)
    graphics_backend()
    robot = build_robot_of(moments[0].choices[0].settings.env, visuals=True)
    for moment, file in zip(moments, files, strict=True):
        print(f"drawing {file} ...", flush=True)
        evaluations = [evaluate(choice) for choice in moment.choices]
        rows = [row_of(evaluation, moment.choices) for evaluation in evaluations]
        strip = policy_strip(robot, rows, title=title_of(moment.choices), **look)
        print(f"wrote {write_image(file, strip)}")


def strip_paths(path: Path, moments: Sequence[Moment]) -> list[Path]:
    """Where the strip of each moment goes: to ``path`` itself where there is one moment only."""
    if len(moments) == 1:
        return [path]
    return [path.with_stem(path.stem + moment.suffix) for moment in moments]


def find_moments(runs: Sequence[Path], which: Checkpoints) -> list[Moment]:
    """The checkpoints asked for, all of them found before the first is drawn.

    Raises:
        ValueError: a run lacks one (names those that it has).
    """
    physics = which.physics
    if any(run.suffix == ".pt" for run in runs):
        if which.iterations or which.shares or which.name:
            raise UserError(
                "with checkpoint files, leave out --checkpoint, --iterations and --shares"
            )
        return [Moment("", tuple(choose(run, None, physics) for run in runs))]
    if which.name is not None:
        return [Moment("", tuple(choose(run, which.name, physics) for run in runs))]
    if which.iterations is not None:
        return [
            Moment(f"-{n:06d}", tuple(_at_iteration(run, n, physics) for run in runs))
            for n in which.iterations
        ]
    return [
        Moment(f"-{share:02g}percent", tuple(_at_share(run, share, physics) for run in runs))
        for share in which.shares or PAPER_SHARES
    ]


def iteration_at(share_percent: float, iterations: int) -> int:
    """The iteration at a share of a training, as the training itself rounds it."""
    return max(1, round(share_percent / 100 * iterations))


def _at_share(run: Path, share: float, physics: str | None) -> Choice:
    config = RunDirectory.open(run).config
    return _at_iteration(run, iteration_at(share, config["scale"]["iterations"]), physics, share)


def _at_iteration(
    run: Path, iteration: int, physics: str | None, share: float | None = None
) -> Choice:
    opened = RunDirectory.open(run)
    there = checkpoint_iterations(opened.path / CHECKPOINTS)
    if iteration not in there:
        total = opened.config["scale"]["iterations"]
        wanted = "" if share is None else f" ({share:g} % of {total})"
        listed = ", ".join(map(str, there)) or "none"
        raise UserError(
            f"{run} has no checkpoint of iteration {iteration}{wanted}; it has {listed}. "
            f"--checkpoint {BEST} or {LAST} takes one that every run has"
        )
    return choose(run, str(iteration), physics)


def check_one_motion(choices: Sequence[Choice]) -> None:
    """Refuse runs that cannot share a reference row.

    Raises:
        ValueError: two runs track different motions or have different robot models.
    """
    first, *others = choices
    robot = build_robot_of(first.settings.env)
    reference = build_clip(first.settings.env, robot).qpos
    for other in others:
        ours, theirs = first.settings.env, other.settings.env
        if ours.robot.mjcf != theirs.robot.mjcf:
            raise UserError(
                f"a strip needs one robot: {first.run.name} has {ours.robot.mjcf or 'the G1'}, "
                f"{other.run.name} has {theirs.robot.mjcf or 'the G1'}"
            )
        if ours.reference_lead != theirs.reference_lead or not same_motion(
            reference, build_clip(theirs, robot).qpos
        ):
            raise UserError(
                "a strip needs one motion: "
                f"{first.run.name} tracks {first.motion} ({ours.reference_lead} steps ahead), "
                f"{other.run.name} tracks {other.motion} ({theirs.reference_lead} steps ahead)"
            )


def title_of(choices: Sequence[Choice]) -> str:
    """What all rows have in common."""
    motion = Path(choices[0].motion).stem.replace("_", "-")
    if len({choice.iteration for choice in choices}) > 1:
        return motion
    lengths = {choice.settings.scale.iterations for choice in choices}
    of = f" of {lengths.pop()}" if len(lengths) == 1 else ""
    return f"{motion}, iteration {choices[0].iteration}{of}"
