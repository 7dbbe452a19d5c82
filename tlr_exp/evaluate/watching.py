"""A policy's roll-out in a viewer."""

from __future__ import annotations

import argparse

from tlr_exp.evaluate.choosing import choose


def watch(options: argparse.Namespace) -> None:
    """``tlr-evaluate RUN --view`` and ``--web``.

    Raises:
        ViewerUnavailable: no display, or a package is missing; before the policy is rolled out.
    """
    choice = choose(options.runs[0], options.checkpoint, options.physics)
    if options.view:
        from tlr_exp.viewing.native import require_display

        require_display()
    else:
        from tlr_exp.viewing.web import require_packages

        require_packages()

    from rich.console import Console

    from tlr_exp.assembly import build_robot_of
    from tlr_exp.evaluate.policies import evaluate
    from tlr_exp.evaluation import result_table
    from tlr_exp.viewing.recording import recording_of_trajectory

    evaluation = evaluate(choice)
    Console().print(result_table(evaluation.result, evaluation.title))
    robot = build_robot_of(choice.settings.env, visuals=True)
    recording = recording_of_trajectory(evaluation.trajectory, evaluation.title)
    if options.view:
        from tlr_exp.viewing.native import view

        view(recording, robot)
    else:
        from tlr_exp.viewing.web import serve

        serve(recording, robot, options.web)
