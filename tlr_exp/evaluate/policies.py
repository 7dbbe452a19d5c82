"""A policy rolled out, and how it is called in pictures."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tlr_exp.assembly import (
    build_clip,
    build_evaluation_env,
    build_judged_split,
    build_robot_of,
)
from tlr_exp.env import TrackingEnv
from tlr_exp.evaluate.choosing import Choice, load_policy
from tlr_exp.evaluation.result import EvaluationResult, evaluate_policy
from tlr_exp.evaluation.trajectory import Trajectory
from tlr_exp.keys import METHOD_NAMES
from tlr_exp.pictures.policy_strips import StripRow
from tlr_exp.records.run_directory import RunDirectory


@dataclass(frozen=True)
class Evaluation:
    """A policy's roll-out and what was measured on it."""

    choice: Choice
    trajectory: Trajectory
    result: EvaluationResult

    @property
    def title(self) -> str:
        choice = self.choice
        return f"{choice.run.name}, iteration {choice.iteration}, {choice.physics} physics"


def evaluate(choice: Choice) -> Evaluation:
    """Roll a policy out and measure it.

    Raises:
        ValueError: as ``load_policy``; the motion cannot be read.
    """
    env, policy = prepare(choice)
    return Evaluation(choice, *evaluate_policy(env, policy, build_judged_split(choice.settings))[0])


def prepare(choice: Choice, starts: int = 1) -> tuple[TrackingEnv, Any]:
    """The environment to roll out in, with a robot for each start phase, and the policy.

    Raises:
        ValueError: as ``evaluate``; the motion is too short for so many starts.
    """
    robot = build_robot_of(choice.settings.env)
    clip = build_clip(choice.settings.env, robot)
    env = build_evaluation_env(choice.settings, robot, clip, starts, key="--starts")
    return env, load_policy(choice)


def method_of(run: Path) -> str:
    """What a run's method is called in pictures: static, two-layered (GWO), ..."""
    method = RunDirectory.open(run).manifest["tags"].get("method") or run.name
    return METHOD_NAMES.get(method, method)


def row_of(evaluation: Evaluation, among: Sequence[Choice]) -> StripRow:
    """A policy's row. Its label tells what it needs to among the others: seed, run, iteration."""
    choice = evaluation.choice
    label = method_of(choice.run)
    rivals = [c for c in among if c is not choice and method_of(c.run) == label]
    if rivals:
        label += f"\nseed {choice.settings.seed}"
        if any(c.settings.seed == choice.settings.seed for c in rivals):
            label += f"\n{choice.run.name}"
    if len({c.iteration for c in among}) > 1:
        label += f"\niteration {choice.iteration}"
    limit = choice.settings.env.termination.max_tilt
    return StripRow(label, evaluation.trajectory, evaluation.result, limit)


def picture_size(size: tuple[int, int] | None) -> dict[str, int]:
    """Width and height as the drawing functions take them; nothing where their own are meant."""
    return {} if size is None else {"width": size[0], "height": size[1]}
