"""One policy measured: a table, JSON, curves of its errors, keyframes and a video."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import Any

from tlr_exp.assembly import build_robot_of
from tlr_exp.evaluate.choosing import Choice, choose
from tlr_exp.evaluate.policies import Evaluation, evaluate, picture_size, row_of
from tlr_exp.evaluation import result_table
from tlr_exp.pictures.graphics import GraphicsUnavailable, graphics_backend
from tlr_exp.records.storage import atomic_write
from tlr_exp.robot import Robot

VIDEO_SIZE = (640, 480)


def measure(options: argparse.Namespace) -> None:
    """``tlr-evaluate RUN``."""
    choice = choose(options.runs[0], options.checkpoint, options.physics)

    from rich.console import Console

    folder = options.output or choice.run / "eval"
    folder.mkdir(parents=True, exist_ok=True)
    evaluation = evaluate(choice)
    Console().print(result_table(evaluation.result, evaluation.title))
    record = {**_origin(choice), **evaluation.result.to_dict()}
    text = json.dumps(record, indent=2, allow_nan=False, ensure_ascii=False)
    name = f"{choice.iteration:06d}-{choice.physics}"
    atomic_write(folder / f"{name}.json", f"{text}\n".encode())
    print(f"wrote {folder / name}.json")
    if options.pictures is not False:
        _plot(folder, name, evaluation)
    _draw(options, folder, name, evaluation)


def _plot(folder: Path, name: str, evaluation: Evaluation) -> None:
    from tlr_exp.pictures.clip_plots import write_figure
    from tlr_exp.pictures.error_plots import body_error_figure, joint_error_figure

    trajectory, title = evaluation.trajectory, evaluation.title
    for kind, figure in (
        ("joints", joint_error_figure(trajectory, title)),
        ("bodies", body_error_figure(trajectory, evaluation.result, title)),
    ):
        print(f"wrote {write_figure(folder / f'{name}_{kind}.png', figure)}")


def _draw(options: argparse.Namespace, folder: Path, name: str, evaluation: Evaluation) -> None:
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
        _draw_keyframes(options, folder / f"{name}_keyframes.png", evaluation, robot)
    if "video" in wanted:
        from tlr_exp.pictures.film import film_evaluation

        print("drawing the video ...", flush=True)
        path = folder / f"{name}.mp4"
        width, height = options.size or VIDEO_SIZE
        film_evaluation(
            *(path, robot, evaluation.trajectory),
            width=width,
            height=height,
            quality=options.quality or "fast",
        )
        print(f"wrote {path}")


def _draw_keyframes(
    options: argparse.Namespace, path: Path, evaluation: Evaluation, robot: Robot
) -> None:
    from tlr_exp.pictures.media import write_image
    from tlr_exp.pictures.policy_strips import policy_strip

    print("drawing the keyframes ...", flush=True)
    strip = policy_strip(
        robot,
        [row_of(evaluation, ())],
        title=evaluation.title,
        columns=options.columns,
        quality=options.quality or "full",
        **picture_size(options.size),
    )
    print(f"wrote {write_image(path, strip)}")


def _origin(choice: Choice) -> dict[str, Any]:
    """What the result is of, for the JSON file."""
    return {
        "run": str(choice.run),
        "checkpoint": choice.checkpoint.name,
        "iteration": choice.iteration,
        "physics": choice.physics,
        "motion": choice.motion,
        "seed": choice.settings.seed,
    }
