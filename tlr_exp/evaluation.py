"""How well a motion was tracked: deterministic roll-outs, and what is measured on them.

The measures are pure functions on arrays; ``rollout`` makes the arrays from an environment.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from statistics import fmean
from typing import Any

import numpy as np
import torch
from tensordict import TensorDictBase
from torchrl.envs.utils import ExplorationType, set_exploration_type, step_mdp

from tlr_exp import g1, keys
from tlr_exp.cores import one_torch_thread

MAX_LAG_S = 0.4
MOVING_RAD = 0.01  # a joint whose standard deviation over the motion is smaller stands still
MIN_CORRELATION = 0.5


@dataclass(frozen=True)
class Trajectory:
    """One robot and its reference at T successive control steps, float64, world frame, SI units.

    Row k is the instant after control step k + 1, with the reference that this step was to reach.
    ``terms`` holds the raw reward terms by name; ``unstable`` is true where the physics state
    stopped being finite (the states are then those of the last finite instant).
    """

    control_dt_s: float
    qpos: np.ndarray  # [T, 30]
    reference_qpos: np.ndarray  # [T, 30]
    body_pos_w: np.ndarray  # [T, 27, 3]
    reference_body_pos_w: np.ndarray  # [T, 27, 3]
    terms: dict[str, np.ndarray]  # each [T]
    unstable: np.ndarray  # [T] bool

    @property
    def num_steps(self) -> int:
        return len(self.qpos)


@dataclass(frozen=True)
class Latency:
    """Delay of the motion behind its reference; ``ms`` is None where it cannot be told.

    ``correlation`` is the mean correlation of the joints at that delay, ``reason`` why ``ms`` is
    None (empty otherwise).
    """

    ms: float | None
    correlation: float | None
    reason: str = ""


@dataclass(frozen=True)
class EvaluationResult:
    """One evaluation; means are over all steps of the motion, failed or not.

    Attributes:
        num_steps: control steps.
        duration_s: the same in seconds.
        survival: share of the steps before training would have ended the episode.
        upright: share of the steps before the robot fell (it may be far off and still upright).
        upper_body_error_m, lower_body_error_m: mean distance of the bodies from the reference.
        joint_error_rad: mean absolute joint error.
        latency_ms: delay behind the reference, negative where the motion is ahead; or None.
        latency_correlation: how alike the joint trajectories are at that delay, at most 1.
        latency_reason: why there is no latency.
        unstable_steps: steps whose physics state was not finite.
        terms: mean raw value of each reward term.
    """

    num_steps: int
    duration_s: float
    survival: float
    upright: float
    upper_body_error_m: float
    lower_body_error_m: float
    joint_error_rad: float
    latency_ms: float | None
    latency_correlation: float | None
    latency_reason: str
    unstable_steps: int
    terms: dict[str, float]

    @property
    def succeeded(self) -> bool:
        """Whether training would never have ended the episode."""
        return self.survival == 1.0

    def to_dict(self) -> dict[str, Any]:
        """Plain values, ready for JSON."""
        return asdict(self)

    def metrics(self) -> dict[str, float]:
        """The numbers under their ``eval/...`` names; NaN where there is no latency."""
        named = asdict(self)
        terms = named.pop("terms")
        del named["latency_reason"], named["num_steps"], named["duration_s"]
        numbers = {**named, **{keys.REWARD_TERM_PREFIX + k: v for k, v in terms.items()}}
        return {
            keys.EVAL_PREFIX + name: float("nan") if value is None else float(value)
            for name, value in numbers.items()
        }


@torch.no_grad()
def rollout(
    env: Any,
    policy: Callable[[TensorDictBase], TensorDictBase],
    term_names: Sequence[str],
    num_steps: int | None = None,
) -> list[Trajectory]:
    """Let the policy act without exploration noise until the motion ends; one item per robot.

    All robots step together; the trajectory of each ends where its motion does.

    Args:
        env: a ``TrackingEnv`` that starts at known frames, without noise and without failures.
        policy: writes the action into a tensordict that holds the observation.
        term_names: the environment's reward terms, in order.
        num_steps: stop after this many control steps; the whole motion by default.

    Raises:
        ValueError: the environment can end an episode by a failure, or ``term_names`` do not fit.
    """
    if env.failures:
        raise ValueError("an evaluation needs an environment with failures=False")
    rows: dict[str, list[torch.Tensor]] = {
        "qpos": [],
        "body_pos_w": [],
        "terms": [],
        "unstable": [],
    }
    deterministic = set_exploration_type(ExplorationType.DETERMINISTIC)
    with deterministic, one_torch_thread(env.device.type):
        now = env.reset()
        starts = env.start_frame.tolist()
        available = env.reference.num_frames - 1 - env.settings.reference_lead
        lengths = [min(num_steps or available, available - start) for start in starts]
        for _ in range(max(lengths)):
            stepped = env.step(policy(now))
            rows["qpos"].append(env.state.qpos)
            rows["body_pos_w"].append(env.state.body_pos_w)
            rows["terms"].append(stepped["next", keys.REWARD_TERMS])
            rows["unstable"].append(stepped["next", keys.UNSTABLE][:, 0])
            now = step_mdp(stepped)
    arrays = {name: _to_numpy(torch.stack(values, dim=1)) for name, values in rows.items()}
    if arrays["terms"].shape[2] != len(term_names):
        raise ValueError(f"{len(term_names)} term names for {arrays['terms'].shape[2]} terms")
    return [
        _trajectory(
            env, {name: array[robot, :length] for name, array in arrays.items()}, start, term_names
        )
        for robot, (start, length) in enumerate(zip(starts, lengths, strict=True))
    ]


def _trajectory(
    env: Any, rows: Mapping[str, np.ndarray], start: int, term_names: Sequence[str]
) -> Trajectory:
    """What one robot did from frame ``start``, beside the reference; ``rows`` are [T, ...]."""
    steps = torch.arange(1, len(rows["qpos"]) + 1, device=env.device)
    reference = env.reference.frame(start + steps + env.settings.reference_lead)
    return Trajectory(
        control_dt_s=env.physics.control_dt,
        qpos=rows["qpos"],
        reference_qpos=_to_numpy(reference.qpos),
        body_pos_w=rows["body_pos_w"],
        reference_body_pos_w=_to_numpy(reference.body_pos_w),
        terms=dict(zip(term_names, rows["terms"].T, strict=True)),
        unstable=rows["unstable"].astype(bool),
    )


def evaluate_policy(
    env: Any,
    policy: Callable[[TensorDictBase], TensorDictBase],
    term_names: Sequence[str],
) -> list[tuple[Trajectory, EvaluationResult]]:
    """Roll the policy out to the end of the motion and measure each robot; see ``rollout``.

    A step counts as a failure beyond the limits to which training tightens its own.
    """
    limits = env.settings.termination
    return [
        (trajectory, evaluate_trajectory(trajectory, limits.max_tilt, limits.distance_end_m))
        for trajectory in rollout(env, policy, term_names)
    ]


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


def _to_numpy(tensor: torch.Tensor) -> np.ndarray:
    return tensor.cpu().double().numpy()


def evaluate_trajectory(
    trajectory: Trajectory, max_tilt: float, max_distance_m: float
) -> EvaluationResult:
    """Measure a trajectory.

    Args:
        trajectory: from ``rollout``; at least one step.
        max_tilt: a larger ``tilt`` is a fall.
        max_distance_m: a body farther than this from its reference is a failure, too.
    """
    distance = body_distance(trajectory.body_pos_w, trajectory.reference_body_pos_w)
    joints, reference_joints = trajectory.qpos[:, 7:], trajectory.reference_qpos[:, 7:]
    tilted = tilt(trajectory.qpos[:, 3:7]) > max_tilt
    failed = tilted | (distance.max(axis=1) > max_distance_m)
    delay = latency(reference_joints, joints, trajectory.control_dt_s)
    return EvaluationResult(
        num_steps=trajectory.num_steps,
        duration_s=trajectory.num_steps * trajectory.control_dt_s,
        survival=share_before_first(failed | trajectory.unstable),
        upright=share_before_first(tilted | trajectory.unstable),
        upper_body_error_m=float(distance[:, g1.UPPER_BODY].mean()),
        lower_body_error_m=float(distance[:, g1.LOWER_BODY].mean()),
        joint_error_rad=float(np.abs(joints - reference_joints).mean()),
        latency_ms=delay.ms,
        latency_correlation=delay.correlation,
        latency_reason=delay.reason,
        unstable_steps=int(trajectory.unstable.sum()),
        terms={name: float(values.mean()) for name, values in trajectory.terms.items()},
    )


def body_distance(body_pos_w: np.ndarray, reference_body_pos_w: np.ndarray) -> np.ndarray:
    """Distance of each body from its reference in m: [T, bodies, 3] twice -> [T, bodies]."""
    return np.linalg.norm(body_pos_w - reference_body_pos_w, axis=-1)


def tilt(quat_wxyz: np.ndarray) -> np.ndarray:
    """Largest |x| or |y| of gravity's direction in the base frame: [T, 4] -> [T]; 0 is upright."""
    w, x, y, z = quat_wxyz.T
    return 2.0 * np.maximum(np.abs(x * z - w * y), np.abs(y * z + w * x))


def share_before_first(event: np.ndarray) -> float:
    """Share of the steps before the first true one; 1 where none is. ``event``: [T] bool, T > 0."""
    return int(np.argmax(event)) / len(event) if event.any() else 1.0


def latency(
    reference: np.ndarray, motion: np.ndarray, dt_s: float, max_lag_s: float = MAX_LAG_S
) -> Latency:
    """Delay of ``motion`` behind ``reference``, by cross-correlation; positive: the motion lags.

    At each whole-step delay the correlation coefficient of each joint is taken over the steps that
    overlap, and averaged over the joints that move; a parabola through the highest value and its
    neighbours gives the fraction of a step.

    Args:
        reference, motion: joint positions [T, joints], rad.
        dt_s: time between rows.
        max_lag_s: longest delay looked for, either way.
    """
    lags = round(max_lag_s / dt_s)
    if len(reference) < 2 * lags + 2:
        return Latency(None, None, f"the motion is shorter than {2 * max_lag_s:g} s")
    moving = np.minimum(reference.std(axis=0), motion.std(axis=0)) > MOVING_RAD
    if not moving.any():
        return Latency(None, None, "no joint moves in both reference and motion")
    curve = np.array(
        [
            _correlation(reference[:, moving], motion[:, moving], lag)
            for lag in range(-lags, lags + 1)
        ]
    )
    peak = int(np.argmax(curve))
    if curve[peak] < MIN_CORRELATION:
        return Latency(
            None, float(curve[peak]), f"the joints' correlation stays below {MIN_CORRELATION:g}"
        )
    if peak in (0, 2 * lags):
        return Latency(None, float(curve[peak]), f"no delay within {max_lag_s:g} s fits best")
    before, top, after = curve[peak - 1 : peak + 2]
    bend = before - 2.0 * top + after
    fraction = 0.5 * (before - after) / bend if bend < 0.0 else 0.0
    return Latency(1000.0 * dt_s * (peak - lags + float(fraction)), float(top))


def _correlation(reference: np.ndarray, motion: np.ndarray, lag: int) -> float:
    """Mean over joints of the correlation of reference[t] with motion[t + lag]."""
    steps = len(reference) - abs(lag)
    a = reference[max(0, -lag) :][:steps]
    b = motion[max(0, lag) :][:steps]
    a, b = a - a.mean(axis=0), b - b.mean(axis=0)
    norm = np.sqrt((a * a).sum(axis=0) * (b * b).sum(axis=0))
    return float(((a * b).sum(axis=0) / np.maximum(norm, 1e-12)).mean())
