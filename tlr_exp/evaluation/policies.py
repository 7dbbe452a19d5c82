"""A policy that a run has learned, rolled out and measured."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from tlr_exp.assembly.environment import build_evaluation_env
from tlr_exp.assembly.split import build_judged_split
from tlr_exp.assembly.terms import terms_of_evaluation
from tlr_exp.assembly.world import build_clip, build_robot_of
from tlr_exp.env.tracking import TrackingEnv
from tlr_exp.evaluation.choosing import Choice, load_policy
from tlr_exp.evaluation.conditions import UNDISTURBED, Condition
from tlr_exp.evaluation.result import EvaluationResult, evaluate_policy
from tlr_exp.evaluation.trajectory import Trajectory


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
    split = build_judged_split(choice.settings, env.term_names)
    return Evaluation(choice, *evaluate_policy(env, policy, split)[0])


def prepare(
    choice: Choice, starts: int = 1, condition: Condition = UNDISTURBED
) -> tuple[TrackingEnv, Any]:
    """The environment to roll out in, with a robot for each start phase, and the policy.

    It reports every lower-layer term of the paper, also those that the run's reward has not.

    Raises:
        ValueError: as ``evaluate``; the motion is too short for so many starts.
    """
    robot = build_robot_of(choice.settings.env)
    clip = build_clip(choice.settings.env, robot)
    terms = terms_of_evaluation(choice.settings)
    env = build_evaluation_env(
        *(choice.settings, robot, clip, terms, starts),
        key="--starts",
        disturbed=condition.applied,
    )
    return env, load_policy(choice)
