"""Configurations of earlier versions: what their keys and classes are called now."""

import copy
from collections.abc import Callable, Mapping
from typing import Any

from tlr_exp.config.input_files import INITIAL
from tlr_exp.config.nested import covers, flat, with_value

# Keys that runs of earlier versions lack, with the value that says what these runs did; of a group
# that they lack, all of its values.
ADDED_KEYS: dict[str, Any] = {
    "reward.penalty_scale": 1.0,
    "reward.ranked": "segment",
    "reward.shaping": [],
    "reward.sigma_rate": None,
    "env.termination.distance_max_m": None,
    "env.termination.mean_episodes": None,
    "ppo.std": "log",
    "curriculum": "none",
    "reading": "none",
    "stages": [],
    "precision": "float32",
    "scale.evaluate_starts": 1,
    "recipe": "paper",
    "ppo.final_learning_rate": None,
    "ppo.decay_from": 0.0,
    INITIAL: None,
    "env.noise": {
        "distribution": "uniform",
        **dict.fromkeys(("gyro", "gravity", "joint_pos", "joint_vel"), 0.0),
        **dict.fromkeys(("heading", "root_pos", "root_lin_vel"), 0.0),
    },
    "env.disturbance": {
        **dict.fromkeys(("push_m_s", "push_every_s", "delay_steps", "friction", "mass", "com_m")),
        **dict.fromkeys(("kp", "kd", "armature")),
    },
}
# Where classes that a configuration names by ``_target_`` were first, and where they are now. The
# first name is the one that counts in a run's identity.
MOVED_MODULES = {
    "tlr_exp.optimizers": "tlr_exp.optimizer",
    "tlr_exp.objective": "tlr_exp.reward.objectives",
    "tlr_exp.rank_agreement": "tlr_exp.reward.rank_agreement",
}


def of_any_version(config: Mapping[str, Any]) -> dict[str, Any]:
    """The plain configuration of a run of any version with all keys, and classes by new names."""
    complete, there = copy.deepcopy(dict(config)), flat(config)
    for key, value in ADDED_KEYS.items():
        if not any(covers([key], each) for each in there):
            complete = with_value(complete, key, copy.deepcopy(value))
    return _with_classes(complete, lambda target: _renamed(target, MOVED_MODULES))


def with_first_names(config: Mapping[str, Any]) -> dict[str, Any]:
    """A plain configuration whose classes have the names that they had in their first version."""
    first = {now: before for before, now in MOVED_MODULES.items()}
    return _with_classes(config, lambda target: _renamed(target, first))


def _with_classes(value: Any, rename: Callable[[str], str]) -> Any:
    if not isinstance(value, Mapping):
        return value
    return {
        key: rename(part)
        if key == "_target_" and isinstance(part, str)
        else _with_classes(part, rename)
        for key, part in value.items()
    }


def _renamed(target: str, modules: Mapping[str, str]) -> str:
    for module, other in modules.items():
        if target.startswith(f"{module}."):
            return other + target.removeprefix(module)
    return target
