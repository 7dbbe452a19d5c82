"""What the keys may be that belong to no part of its own: one table, checked at once.

A part that ``_target_`` names checks its settings itself, and the robot's are checked where it is
made.
"""

import math
import re
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from operator import attrgetter
from pathlib import Path
from typing import Any

from tlr_exp.config.checks import (
    SettingError,
    check_above,
    check_at_least,
    check_choice,
    check_within,
    refusal,
)
from tlr_exp.config.settings import EnvSettings, Settings
from tlr_exp.errors import UserError

OBSERVATIONS = ("history", "reference")
ACTIONS = ("default_pose", "current_pose", "reference_pose", "reference_motion")
START_PHASES = ("random", "adaptive", "zero")
DISTRIBUTIONS = ("uniform", "gaussian")
RANKED = ("segment", "episode", "per_step", "age_matched")
STAGE_CONDITIONS = ("iteration", "episode_length", "goal_share", "body_error_m")
ACTIVATIONS = ("elu", "relu", "tanh")
STANDARD_DEVIATIONS = ("log", "linear")
PRECISIONS = ("auto", "float32", "bfloat16")
RESUME_MODES = ("in_sweeps", "never", "auto")

RANGE = "[low, high], or null"  # what each key of env.disturbance may be

Check = Callable[[str, Any], None]  # of a key and its value


def _one_of(choices: Sequence[str]) -> Check:
    return partial(check_choice, allowed=choices)


def _at_least(low: float) -> Check:
    return partial(check_at_least, low=low)


def _within(low: float, high: float) -> Check:
    return partial(check_within, low=low, high=high)


_ABOVE_0 = partial(check_above, low=0)


def _check_seed(key: str, seed: int) -> None:
    if not 0 <= seed < 2**63:
        raise refusal(key, seed, "from 0 to 2^63 - 1")


def _check_device(key: str, device: str) -> None:
    if re.fullmatch(r"cpu|cuda(:\d+)?", device) is None:
        raise refusal(key, device, "cpu, cuda, or cuda:N")


def _check_resume(key: str, resume: str) -> None:
    if resume not in RESUME_MODES and not Path(resume).is_dir():
        modes = ", ".join(RESUME_MODES)
        raise refusal(key, resume, f"{modes}, or the directory of a run that is there")


def _check_layers(key: str, widths: Sequence[int]) -> None:
    if any(width < 1 for width in widths):
        raise refusal(key, widths, "a list of layer widths of at least 1")


def _check_share_below_1(key: str, share: float) -> None:
    if not 0 <= share < 1:
        raise refusal(key, share, "from 0 to below 1")


def _range_of(check: Check) -> Check:
    """Two numbers, the lower one first, of which each passes a check."""

    def check_range(key: str, bounds: Sequence[float]) -> None:
        if len(bounds) != 2 or not bounds[0] <= bounds[1]:
            raise refusal(key, bounds, RANGE)
        for bound in bounds:
            check(key, bound)

    return check_range


LIMITS: Mapping[str, Check] = {
    "seed": _check_seed,
    "device": _check_device,
    "num_threads": _at_least(0),
    "precision": _one_of(PRECISIONS),
    "resume": _check_resume,
    "env.observation": _one_of(OBSERVATIONS),
    "env.action": _one_of(ACTIONS),
    "env.start_phase": _one_of(START_PHASES),
    "env.reference_lead": _at_least(0),
    "env.reset_noise.root_pos_m": _at_least(0),
    "env.reset_noise.root_rot_rad": _within(0, math.pi),
    "env.reset_noise.root_lin_vel": _at_least(0),
    "env.reset_noise.root_ang_vel": _at_least(0),
    "env.reset_noise.joint_pos_rad": _at_least(0),
    "env.reset_noise.joint_vel": _at_least(0),
    "env.noise.distribution": _one_of(DISTRIBUTIONS),
    "env.noise.gyro": _at_least(0),
    "env.noise.gravity": _within(0, math.pi),
    "env.noise.joint_pos": _at_least(0),
    "env.noise.joint_vel": _at_least(0),
    "env.noise.heading": _within(0, math.pi),
    "env.noise.root_pos": _at_least(0),
    "env.noise.root_lin_vel": _at_least(0),
    "env.disturbance.push_m_s": _range_of(_at_least(0)),
    "env.disturbance.push_every_s": _range_of(_ABOVE_0),
    "env.disturbance.delay_steps": _range_of(_within(0, 50)),
    "env.disturbance.friction": _range_of(_ABOVE_0),
    "env.disturbance.mass": _range_of(_ABOVE_0),
    "env.disturbance.com_m": _range_of(_at_least(0)),
    "env.disturbance.kp": _range_of(_ABOVE_0),
    "env.disturbance.kd": _range_of(_at_least(0)),
    "env.disturbance.armature": _range_of(_ABOVE_0),
    "env.termination.max_tilt": _within(0, 1),
    "env.termination.distance_start_m": _ABOVE_0,
    "env.termination.distance_end_m": _ABOVE_0,
    "env.termination.distance_max_m": _ABOVE_0,
    "env.termination.tighten_rate": _within(0, 1),
    "env.termination.tighten_above_steps": _at_least(0),
    "env.termination.loosen_below_steps": _at_least(0),
    "env.termination.mean_episodes": _at_least(1),
    "reward.penalty_scale": _at_least(0),
    "reward.ranked": _one_of(RANKED),
    "reward.sigma_rate": _within(0, 1),
    "ppo.num_steps": _at_least(1),
    "ppo.num_epochs": _at_least(1),
    "ppo.num_minibatches": _at_least(1),
    "ppo.gamma": _within(0, 1),
    "ppo.gae_lambda": _within(0, 1),
    "ppo.clip_epsilon": _ABOVE_0,
    "ppo.value_clip": _ABOVE_0,
    "ppo.critic_coeff": _at_least(0),
    "ppo.entropy_coeff": _at_least(0),
    "ppo.max_grad_norm": _ABOVE_0,
    "ppo.learning_rate": _ABOVE_0,
    "ppo.final_learning_rate": _ABOVE_0,
    "ppo.decay_from": _check_share_below_1,
    "ppo.min_learning_rate": _ABOVE_0,
    "ppo.max_learning_rate": _ABOVE_0,
    "ppo.target_kl": _ABOVE_0,
    "ppo.hidden_sizes": _check_layers,
    "ppo.activation": _one_of(ACTIVATIONS),
    "ppo.initial_std": _ABOVE_0,
    "ppo.std": _one_of(STANDARD_DEVIATIONS),
    "scale.num_envs": _at_least(1),
    "scale.iterations": _at_least(1),
    "scale.evaluate_every": _at_least(1),
    "scale.evaluate_starts": _at_least(1),
    "scale.checkpoint_every": _at_least(1),
    "scale.keep_checkpoints": _at_least(1),
}


def violations(settings: Settings) -> list[str]:
    """One line for each value that the table does not allow; null, where it may be, is passed over.

    The values have the types that ``Settings`` says.
    """
    found = []
    for key, check in LIMITS.items():
        value = attrgetter(key)(settings)
        try:
            if value is not None:
                check(key, value)
        except SettingError as error:
            found.append(str(error))
    return found


def check_env(settings: EnvSettings) -> None:
    """Refuse choices of the environment that do not exist, wherever its settings come from.

    Raises:
        SettingError: names the key and the choices.
    """
    for name in ("observation", "action", "start_phase"):
        LIMITS[f"env.{name}"](f"env.{name}", getattr(settings, name))


def check_starts(key: str, starts: int, num_steps: int) -> None:
    """Refuse more start phases than a motion of ``num_steps`` control steps has.

    Raises:
        UserError: names the key and both numbers.
    """
    if starts > num_steps:
        raise UserError(f"{key} is {starts}; the motion has only {num_steps} steps")
