"""One policy measured: a table, JSON, curves of its errors, keyframes and a video."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from tlr_exp.assembly.world import build_robot_of
from tlr_exp.commands.evaluate.result_table import result_table
from tlr_exp.commands.evaluate.strip_rows import row_of
from tlr_exp.evaluation.choosing import choose
from tlr_exp.evaluation.policies import Evaluation
from tlr_exp.evaluation.records import (
    content_of,
    evaluation_folder,
    evaluation_name,
    write_whole,
)
from tlr_exp.evaluation.starts import evaluate_starts, record_of, starts_table
from tlr_exp.pictures.graphics import GraphicsUnavailable, graphics_backend
from tlr_exp.records.outputs import check_free
from tlr_exp.robot.model import Robot

VIDEO_SIZE = (640, 480)


def measure(options: argparse.Namespace) -> None:
    """``tlr-evaluate RUN``.

    Raises:
        FileExistsError: pictures are there already, or other numbers, and --force is not given.
        GraphicsUnavailable: a picture was asked for that cannot be drawn on this machine.
    """
    choice = choose(options.runs[0], options.checkpoint, options.physics)

    from rich.console import Console

    folder = options.output or evaluation_folder(choice)
    num_starts = options.starts or 1
    paths = output_paths(options, folder, evaluation_name(choice, num_starts))
    check_free([path for part, path in paths.items() if part != "json"], options.force)
    folder.mkdir(parents=True, exist_ok=True)
    evaluation, starts = evaluate_starts(choice, num_starts)
    Console().print(result_table(evaluation.result, evaluation.title))
    if num_starts > 1:
        Console().print(starts_table(starts, f"from {num_starts} start phases"))
    record = record_of(evaluation, starts)
    print(write_whole(paths["json"], content_of(record), options.force))
    if options.pictures is not False:
        _plot(paths, evaluation)
    _draw(options, paths, evaluation)


def output_paths(options: argparse.Namespace, folder: Path, name: str) -> dict[str, Path]:
    """What is to be written, by the names of its parts; ``json`` is always among it."""
    endings = {"json": ".json"}
    if options.pictures is not False:
        endings |= {part: f"_{part}.png" for part in ("joints", "bodies", "keyframes")}
    if options.video is not False:
        endings["video"] = ".mp4"
    return {part: folder / f"{name}{ending}" for part, ending in endings.items()}


def _plot(paths: dict[str, Path], evaluation: Evaluation) -> None:
    from tlr_exp.pictures.clip_plots import write_figure
    from tlr_exp.pictures.error_plots import body_error_figure, joint_error_figure

    trajectory, title = evaluation.trajectory, evaluation.title
    for kind, figure in (
        ("joints", joint_error_figure(trajectory, title)),
        ("bodies", body_error_figure(trajectory, evaluation.result, title)),
    ):
        print(f"wrote {write_figure(paths[kind], figure)}")


def _draw(options: argparse.Namespace, paths: dict[str, Path], evaluation: Evaluation) -> None:
    wanted = [part for part in ("pictures", "video") if getattr(options, part) is not False]
    if not wanted:
        return
    try:
        graphics_backend()
    except GraphicsUnavailable as error:
        if options.pictures or options.video:
            raise
        print(error, file=sys.stderr)
        return
    robot = build_robot_of(evaluation.choice.settings.env, visuals=True)
    if "pictures" in wanted:
        _draw_keyframes(paths["keyframes"], evaluation, robot, options.columns)
    if "video" in wanted:
        _film(options, paths["video"], evaluation, robot)


def _draw_keyframes(path: Path, evaluation: Evaluation, robot: Robot, columns: int) -> None:
    """In the strip's own size and quality: --size and --quality are the video's."""
    from tlr_exp.pictures.media import write_image
    from tlr_exp.pictures.policy_strips import policy_strip

    print("drawing the keyframes ...", flush=True)
    strip = policy_strip(robot, [row_of(evaluation, ())], title=evaluation.title, columns=columns)
    print(f"wrote {write_image(path, strip)}")


def _film(options: argparse.Namespace, path: Path, evaluation: Evaluation, robot: Robot) -> None:
    from tlr_exp.pictures.film import film_evaluation

    print("drawing the video ...", flush=True)
    width, height = options.size or VIDEO_SIZE
    film_evaluation(
        *(path, robot, evaluation.trajectory),
        width=width,
        height=height,
        quality=options.quality or "fast",
    )
    print(f"wrote {path}")
