"""All measures of a roll-out together, and their means over several."""

import math
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from statistics import fmean
from typing import Any

import numpy as np
from tensordict import TensorDictBase

from tlr_exp import keys
from tlr_exp.evaluation.distances import body_distance, seen_from_the_pelvis, tilt
from tlr_exp.evaluation.effort import mean_power, mean_torque
from tlr_exp.evaluation.endings import ending, share_before_first
from tlr_exp.evaluation.latency import latency
from tlr_exp.evaluation.rollout import rollout
from tlr_exp.evaluation.trajectory import Trajectory
from tlr_exp.keys import Ending
from tlr_exp.reward.split import RewardSplit


@dataclass(frozen=True)
class EvaluationResult:
    """One evaluation; means are over all steps of the motion, failed or not.

    docs/measures.md gives formulas and sources.

    Attributes:
        num_steps: control steps.
        duration_s: the same in seconds.
        survival: share of the steps before training would have ended the episode.
        upright: share of the steps before the robot fell (it may be far off and still upright).
        ended_by: why training would have ended the episode.
        upper_body_error_m, lower_body_error_m: mean distance of the bodies from the reference.
        upper_body_error_root_m, lower_body_error_root_m: the same as seen from the pelvis, so that
            a motion that as a whole is shifted or turned has none.
        joint_error_rad: mean absolute joint error.
        joint_velocity_error_rad_s: mean absolute error of the joint velocities.
        latency_ms: delay behind the reference, negative where the motion is ahead; or None.
        latency_correlation: how alike the joint trajectories are at that delay, at most 1.
        latency_reason: why there is no latency.
        torque_nm: mean absolute torque of a joint.
        power_w: mechanical power of all joints.
        goal_reward_per_s: upper layer of the reward.
        lower_layer_cost_per_s: what the lower layer takes from it at weights 1.
        unstable_steps: steps whose physics state was not finite.
        terms: mean raw value of each reward term.
    """

    num_steps: int
    duration_s: float
    survival: float
    upright: float
    ended_by: Ending
    upper_body_error_m: float
    lower_body_error_m: float
    upper_body_error_root_m: float
    lower_body_error_root_m: float
    joint_error_rad: float
    joint_velocity_error_rad_s: float
    latency_ms: float | None
    latency_correlation: float | None
    latency_reason: str
    torque_nm: float
    power_w: float
    goal_reward_per_s: float
    lower_layer_cost_per_s: float
    unstable_steps: int
    terms: dict[str, float]

    @property
    def succeeded(self) -> bool:
        """Whether training would never have ended the episode."""
        return self.ended_by == Ending.COMPLETED

    def to_dict(self) -> dict[str, Any]:
        """Plain values, ready for JSON."""
        return {**asdict(self), "ended_by": self.ended_by.value}

    def metrics(self) -> dict[str, float]:
        """The numbers under their ``eval/...`` names; NaN where there is no latency."""
        named = asdict(self)
        terms, ended_by = named.pop("terms"), named.pop("ended_by")
        del named["latency_reason"], named["num_steps"], named["duration_s"]
        numbers = {
            **{keys.EVAL_PREFIX + name: value for name, value in named.items()},
            **{f"{keys.EVAL_ENDED_BY}{kind}": ended_by == kind for kind in Ending},
            **{
                f"{keys.EVAL_PREFIX}{keys.REWARD_TERM_PREFIX}{name}": value
                for name, value in terms.items()
            },
        }
        return {
            name: math.nan if value is None else float(value) for name, value in numbers.items()
        }


def evaluate_policy(
    env: Any, policy: Callable[[TensorDictBase], TensorDictBase], split: RewardSplit
) -> list[tuple[Trajectory, EvaluationResult]]:
    """Roll the policy out to the end of the motion and measure each robot; see ``rollout``.

    A step counts as a failure beyond the limits to which training tightens its own. ``split`` has
    the coefficients of the two layers.
    """
    limits = env.settings.termination
    return [
        (trajectory, evaluate_trajectory(trajectory, limits.max_tilt, limits.distance_end_m, split))
        for trajectory in rollout(env, policy)
    ]


def evaluate_trajectory(
    trajectory: Trajectory, max_tilt: float, max_distance_m: float, split: RewardSplit
) -> EvaluationResult:
    """Measure a trajectory.

    Args:
        trajectory: from ``rollout``; at least one step.
        max_tilt: a larger ``tilt`` is a fall.
        max_distance_m: a body farther than this from its reference is a failure, too.
        split: the coefficients of the two layers; the trajectory has all their terms.
    """
    qpos, reference_qpos = trajectory.qpos, trajectory.reference_qpos
    joint_vel, reference_joint_vel = trajectory.qvel[:, 6:], trajectory.reference_qvel[:, 6:]
    distance = body_distance(trajectory.body_pos_w, trajectory.reference_body_pos_w)
    upper, lower = trajectory.spec.upper_body, trajectory.spec.lower_body
    pelvis = trajectory.spec.pelvis
    distance_root = body_distance(
        seen_from_the_pelvis(trajectory.body_pos_w, pelvis, qpos[:, 3:7]),
        seen_from_the_pelvis(trajectory.reference_body_pos_w, pelvis, reference_qpos[:, 3:7]),
    )
    tilted, far = tilt(qpos[:, 3:7]) > max_tilt, distance.max(axis=1) > max_distance_m
    delay = latency(reference_qpos[:, 7:], qpos[:, 7:], trajectory.control_dt_s)
    terms = {name: float(values.mean()) for name, values in trajectory.terms.items()}
    goal_reward, lower_layer_cost = split.layers(terms)
    return EvaluationResult(
        num_steps=trajectory.num_steps,
        duration_s=trajectory.num_steps * trajectory.control_dt_s,
        survival=share_before_first(tilted | far | trajectory.unstable),
        upright=share_before_first(tilted | trajectory.unstable),
        ended_by=ending(trajectory.unstable, tilted, far),
        upper_body_error_m=float(distance[:, upper].mean()),
        lower_body_error_m=float(distance[:, lower].mean()),
        upper_body_error_root_m=float(distance_root[:, upper].mean()),
        lower_body_error_root_m=float(distance_root[:, lower].mean()),
        joint_error_rad=float(np.abs(qpos[:, 7:] - reference_qpos[:, 7:]).mean()),
        joint_velocity_error_rad_s=float(np.abs(joint_vel - reference_joint_vel).mean()),
        latency_ms=delay.ms,
        latency_correlation=delay.correlation,
        latency_reason=delay.reason,
        torque_nm=mean_torque(trajectory.joint_torque),
        power_w=mean_power(trajectory.joint_torque, joint_vel),
        goal_reward_per_s=goal_reward,
        lower_layer_cost_per_s=lower_layer_cost,
        unstable_steps=int(trajectory.unstable.sum()),
        terms=terms,
    )


def mean_metrics(results: Sequence[EvaluationResult]) -> dict[str, float]:
    """The ``eval/...`` metrics of several roll-outs: the means of theirs; of one, its own.

    Roll-outs that lack a number (a short one has no latency) do not count in its mean; it is NaN
    where all lack it. Of several there is ``eval/success``, too: the share that succeeded.
    """
    each = [result.metrics() for result in results]
    means = {name: _mean_of_known([metrics[name] for metrics in each]) for name in each[0]}
    if len(results) > 1:
        means[keys.EVAL_SUCCESS] = fmean(result.succeeded for result in results)
    return means


def _mean_of_known(values: Sequence[float]) -> float:
    known = [value for value in values if not math.isnan(value)]
    return fmean(known) if known else math.nan
