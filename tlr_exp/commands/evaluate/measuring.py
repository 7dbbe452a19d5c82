"""One policy measured: a table, JSON, curves of its errors, keyframes and a video."""

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tlr_exp.assembly.world import build_robot_of
from tlr_exp.commands.evaluate.result_table import result_table
from tlr_exp.commands.evaluate.strip_rows import row_of
from tlr_exp.evaluation.choosing import Choice
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


@dataclass(frozen=True)
class Pictures:
    """What is drawn of an evaluation.

    Attributes:
        pictures, video: asked for, not wanted, or None: where this machine can draw.
        columns: moments of the keyframes.
        film: size and quality of the video, as ``film`` takes them.
    """

    pictures: bool | None
    video: bool | None
    columns: int
    film: dict[str, Any]


def measure(
    choice: Choice, num_starts: int, drawn: Pictures, output: Path | None, force: bool
) -> None:
    """``tlr-evaluate RUN``.

    Raises:
        FileExistsError: pictures are there already, or other numbers, and --force is not given.
        GraphicsUnavailable: a picture was asked for that cannot be drawn on this machine.
    """
    from rich.console import Console

    folder = output or evaluation_folder(choice)
    paths = output_paths(drawn, folder, evaluation_name(choice, num_starts))
    check_free([path for part, path in paths.items() if part != "json"], force)
    folder.mkdir(parents=True, exist_ok=True)
    evaluation, starts = evaluate_starts(choice, num_starts)
    Console().print(result_table(evaluation.result, evaluation.title))
    if num_starts > 1:
        Console().print(starts_table(starts, f"from {num_starts} start phases"))
    record = record_of(evaluation, starts)
    print(write_whole(paths["json"], content_of(record), force))
    if drawn.pictures is not False:
        _plot(paths, evaluation)
    _draw(drawn, paths, evaluation)


def output_paths(drawn: Pictures, folder: Path, name: str) -> dict[str, Path]:
    """What is to be written, by the names of its parts; ``json`` is always among it."""
    endings = {"json": ".json"}
    if drawn.pictures is not False:
        endings |= {part: f"_{part}.png" for part in ("joints", "bodies", "keyframes")}
    if drawn.video is not False:
        endings["video"] = ".mp4"
    return {part: folder / f"{name}{ending}" for part, ending in endings.items()}


def _plot(paths: dict[str, Path], evaluation: Evaluation) -> None:
    from tlr_exp.pictures.media import write_figure
    from tlr_exp.pictures.plots import body_error_figure, joint_error_figure

    trajectory, title = evaluation.trajectory, evaluation.title
    for kind, figure in (
        ("joints", joint_error_figure(trajectory, title)),
        ("bodies", body_error_figure(trajectory, evaluation.result, title)),
    ):
        print(f"wrote {write_figure(paths[kind], figure)}")


def _draw(drawn: Pictures, paths: dict[str, Path], evaluation: Evaluation) -> None:
    if not {"keyframes", "video"} & paths.keys():
        return
    try:
        graphics_backend()
    except GraphicsUnavailable as error:
        if drawn.pictures or drawn.video:
            raise
        print(error, file=sys.stderr)
        return
    robot = build_robot_of(evaluation.choice.settings.env, visuals=True)
    if "keyframes" in paths:
        _draw_keyframes(paths["keyframes"], evaluation, robot, drawn.columns)
    if "video" in paths:
        _film(drawn, paths["video"], evaluation, robot)


def _draw_keyframes(path: Path, evaluation: Evaluation, robot: Robot, columns: int) -> None:
    """In the strip's own size and quality: --size and --quality are the video's."""
    from tlr_exp.pictures.media import write_image
    from tlr_exp.pictures.strips import policy_strip

    print("drawing the keyframes ...", flush=True)
    strip = policy_strip(robot, [row_of(evaluation, ())], title=evaluation.title, columns=columns)
    print(f"wrote {write_image(path, strip)}")


def _film(drawn: Pictures, path: Path, evaluation: Evaluation, robot: Robot) -> None:
    from tlr_exp.pictures.film import film
    from tlr_exp.pictures.recording import recording_of_trajectory

    print("drawing the video ...", flush=True)
    film(
        path, robot, recording_of_trajectory(evaluation.trajectory, evaluation.title), **drawn.film
    )
    print(f"wrote {path}")
