"""A policy's roll-out in a viewer."""

from tlr_exp.evaluation.choosing import Choice
from tlr_exp.viewing.viewer import Viewer


def watch(choice: Choice, viewer: Viewer) -> None:
    """``tlr-evaluate RUN --view`` and ``--web``.

    Raises:
        ViewerUnavailable: no display, or a package is missing; before the policy is rolled out.
    """
    viewer.require()

    from rich.console import Console

    from tlr_exp.assembly.world import build_robot_of
    from tlr_exp.commands.evaluate.result_table import result_table
    from tlr_exp.evaluation.policies import evaluate
    from tlr_exp.pictures.recording import recording_of_trajectory

    evaluation = evaluate(choice)
    Console().print(result_table(evaluation.result, evaluation.title))
    recording = recording_of_trajectory(evaluation.trajectory, evaluation.title)
    viewer.play(recording, build_robot_of(choice.settings.env, visuals=True))
