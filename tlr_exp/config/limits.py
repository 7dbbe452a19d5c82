"""What each configuration key may be: one table, checked before anything heavy is loaded."""

import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

GAIN_SETS = ("beyondmimic", "asap")
COLLISION_SETS = ("feet", "full")
OBSERVATIONS = ("history", "reference")
ACTIONS = ("default_pose", "current_pose", "reference_pose", "reference_motion")
START_PHASES = ("random", "adaptive", "zero")
ACTIVATIONS = ("elu", "relu", "tanh")
PRECISIONS = ("auto", "float32", "bfloat16")
RESUME_MODES = ("in_sweeps", "never", "auto")


@dataclass(frozen=True)
class Constraint:
    """A test of a value and the words that say what passes it."""

    allowed: str
    holds: Callable[[Any], bool]


def one_of(choices: Sequence[str]) -> Constraint:
    return Constraint(", ".join(choices), lambda value: value in choices)


def at_least(low: float) -> Constraint:
    return Constraint(f"at least {low:g}", lambda value: low <= value < math.inf)


def above(low: float) -> Constraint:
    return Constraint(f"above {low:g}", lambda value: low < value < math.inf)


def within(low: float, high: float) -> Constraint:
    return Constraint(f"from {low:g} to {high:g}", lambda value: low <= value <= high)


def inside(low: float, high: float) -> Constraint:
    return Constraint(f"above {low:g} and below {high:g}", lambda value: low < value < high)


_DEVICE = Constraint(
    "cpu, cuda, or cuda:N",
    lambda value: re.fullmatch(r"cpu|cuda(:\d+)?", value) is not None,
)
_RESUME = Constraint(
    f"{', '.join(RESUME_MODES)}, or the directory of a run that is there",
    lambda value: value in RESUME_MODES or Path(value).is_dir(),
)
_LAYERS = Constraint(
    "a list of layer widths of at least 1", lambda value: all(width >= 1 for width in value)
)

CONSTRAINTS: Mapping[str, Constraint] = {
    "seed": Constraint("from 0 to 2^63 - 1", lambda value: 0 <= value < 2**63),
    "device": _DEVICE,
    "num_threads": at_least(0),
    "precision": one_of(PRECISIONS),
    "resume": _RESUME,
    "env.robot.gains": one_of(GAIN_SETS),
    "env.robot.collisions": one_of(COLLISION_SETS),
    "env.observation": one_of(OBSERVATIONS),
    "env.action": one_of(ACTIONS),
    "env.start_phase": one_of(START_PHASES),
    "env.reference_lead": at_least(0),
    "env.reset_noise.root_pos_m": at_least(0),
    "env.reset_noise.root_rot_rad": within(0, math.pi),
    "env.reset_noise.root_lin_vel": at_least(0),
    "env.reset_noise.root_ang_vel": at_least(0),
    "env.reset_noise.joint_pos_rad": at_least(0),
    "env.reset_noise.joint_vel": at_least(0),
    "env.termination.max_tilt": within(0, 1),
    "env.termination.distance_start_m": above(0),
    "env.termination.distance_end_m": above(0),
    "env.termination.tighten_rate": within(0, 1),
    "env.termination.tighten_above_steps": at_least(0),
    "env.termination.loosen_below_steps": at_least(0),
    "physics.num_threads": at_least(0),
    "physics.impl": one_of(("jax", "warp")),
    "physics.max_contacts": at_least(1),
    "physics.max_constraints": at_least(1),
    "reward.penalty_scale": at_least(0),
    "reward.objective.threshold_share": inside(0, 1),
    "optimizer.pack_size": at_least(3),
    "optimizer.iterations": at_least(1),
    "optimizer.tie_break": one_of(("first", "largest_norm")),
    "optimizer.budget": at_least(1),
    "optimizer.strategy": one_of(("rand1bin", "best1bin")),
    "optimizer.scale": within(0, 2),
    "optimizer.crossover": within(0, 1),
    "optimizer.inertia": within(0, 1),
    "optimizer.cognitive": within(0, 4),
    "optimizer.social": within(0, 4),
    "optimizer.initial_std": within(1e-6, 1),
    "optimizer.resampling": at_least(1),
    "optimizer.population": at_least(3),
    "optimizer.elites": at_least(3),
    "optimizer.inner_iterations": at_least(1),
    "optimizer.start_points": at_least(1),
    "optimizer.walks": at_least(1),
    "optimizer.levels": at_least(2),
    "optimizer.min_share": within(0, 1),
    "optimizer.initial": at_least(0),
    "optimizer.rate": within(0, 1),
    "optimizer.reference_share": above(0),
    "optimizer.integral_gain": at_least(0),
    "optimizer.proportional_gain": at_least(0),
    "optimizer.derivative_gain": at_least(0),
    "optimizer.largest": above(0),
    "ppo.num_steps": at_least(1),
    "ppo.num_epochs": at_least(1),
    "ppo.num_minibatches": at_least(1),
    "ppo.gamma": within(0, 1),
    "ppo.gae_lambda": within(0, 1),
    "ppo.clip_epsilon": above(0),
    "ppo.value_clip": above(0),
    "ppo.critic_coeff": at_least(0),
    "ppo.entropy_coeff": at_least(0),
    "ppo.max_grad_norm": above(0),
    "ppo.learning_rate": above(0),
    "ppo.final_learning_rate": above(0),
    "ppo.decay_from": Constraint("from 0 to below 1", lambda value: 0 <= value < 1),
    "ppo.min_learning_rate": above(0),
    "ppo.max_learning_rate": above(0),
    "ppo.target_kl": above(0),
    "ppo.hidden_sizes": _LAYERS,
    "ppo.activation": one_of(ACTIVATIONS),
    "ppo.initial_std": above(0),
    "scale.num_envs": at_least(1),
    "scale.iterations": at_least(1),
    "scale.evaluate_every": at_least(1),
    "scale.evaluate_starts": at_least(1),
    "scale.checkpoint_every": at_least(1),
    "scale.keep_checkpoints": at_least(1),
}


def check_choice(key: str, value: str, allowed: Sequence[str]) -> None:
    """Refuse a value that is not among the choices; for parts built without a configuration.

    Raises:
        ValueError: names the key and the choices.
    """
    if value not in allowed:
        raise ValueError(f"{key} is {value!r}; allowed are {', '.join(allowed)}")


def check_starts(key: str, starts: int, num_steps: int) -> None:
    """Refuse more start phases than a motion of ``num_steps`` control steps has.

    Raises:
        ValueError: names the key and both numbers.
    """
    if starts > num_steps:
        raise ValueError(f"{key} is {starts}; the motion has only {num_steps} steps")


def violations(config: Mapping[str, Any]) -> list[str]:
    """One line for each value of ``config`` (nested plain data) that breaks its constraint.

    Keys that the configuration does not have, and those that are null, are passed over.
    """
    found = []
    for key, constraint in CONSTRAINTS.items():
        value = _look_up(config, key)
        if value is None:
            continue
        try:
            valid = constraint.holds(value)
        except (TypeError, AttributeError):
            valid = False
        if not valid:
            found.append(f"{key} is {value!r}; allowed: {constraint.allowed}")
    return found


def _look_up(config: Mapping[str, Any], key: str) -> Any:
    value: Any = config
    for part in key.split("."):
        if not isinstance(value, Mapping) or part not in value:
            return None
        value = value[part]
    return value
