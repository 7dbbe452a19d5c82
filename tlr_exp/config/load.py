"""From Hydra's configuration to checked ``Settings``: types, allowed values, what fits together.

Hydra and OmegaConf stay within this file and the entry points. Nothing heavy is imported, so
that a mistake shows within a second or two.
"""

import copy
import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any, get_type_hints

from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import OmegaConfBaseException

from tlr_exp.config.checks import SettingError, check_above, no_such_key
from tlr_exp.config.input_files import INITIAL, is_motion_path
from tlr_exp.config.limits import RANGE, violations
from tlr_exp.config.reading import reading_problems
from tlr_exp.config.settings import RewardSettings, Settings
from tlr_exp.config.stages import stage_problems
from tlr_exp.env.terms import COSTS, STATE_COSTS, TERMS
from tlr_exp.errors import UserError
from tlr_exp.motion.clips import motion_names
from tlr_exp.records.checkpoint_files import initial_checkpoint
from tlr_exp.records.final_metrics import final_terms
from tlr_exp.records.run_directory import RunDirectory, RunDirectoryError

CONFIG_PATH = "pkg://tlr_exp.conf"


class ConfigError(UserError):
    """The configuration is wrong; each line names a key and what is allowed."""


def plain_config(config: DictConfig) -> dict[str, Any]:
    """The resolved configuration as plain data, without Hydra's own part."""
    return OmegaConf.to_container(OmegaConf.masked_copy(config, _own_keys(config)), resolve=True)  # type: ignore[return-value]


def with_absolute_paths(config: Mapping[str, Any]) -> dict[str, Any]:
    """A plain configuration that means the same files whenever and wherever it is read again.

    A run to begin from becomes the checkpoint of it that is the best one now; a run whose costs are
    limits becomes these limits.

    Raises:
        ConfigError: there is no run or checkpoint to begin from, or no run to take limits from, or
            their share is not above 0.
    """
    env = dict(config["env"])
    robot = dict(env["robot"])
    if robot["mjcf"] is not None:
        robot["mjcf"] = str(Path(robot["mjcf"]).absolute())
    if is_motion_path(env["motion"]):
        env["motion"] = str(Path(env["motion"]).absolute())
    return {
        **config,
        "env": {**env, "robot": robot},
        "optimizer": _with_limits(config["optimizer"]),
        INITIAL: _initial_file(config),
    }


def _with_limits(optimizer: Mapping[str, Any], key: str = "optimizer") -> dict[str, Any]:
    """An optimizer whose limits, where ``reference`` names a run, are shares of that run's costs.

    So are those of the optimizers inside it. A cost that the run does not have gets no limit.
    """
    inside = {name: _with_limits(part, f"{key}.{name}") for name, part in _groups(optimizer)}
    if optimizer.get("reference") is not None and _has_limits(optimizer):
        limits = _reference_limits(key, optimizer["reference"], optimizer["reference_share"])
        inside |= {"limits": limits, "reference": None, "reference_share": 1.0}
    return {**optimizer, **inside}


def _groups(config: Mapping[str, Any]) -> Iterator[tuple[str, Mapping[str, Any]]]:
    return ((name, value) for name, value in config.items() if isinstance(value, Mapping))


def _reference_limits(key: str, reference: Any, share: float) -> dict[str, float]:
    """Shares of a run's costs; ``key``: of the optimizer, for the messages."""
    try:
        costs = final_terms(RunDirectory.open(Path(str(reference))).metrics())
    except RunDirectoryError as error:
        raise ConfigError(f"{key}.reference: {error}") from error
    try:
        check_above(f"{key}.reference_share", share, 0.0)
    except SettingError as error:
        raise ConfigError(str(error)) from error
    limits = {name: share * cost for name, cost in costs.items() if name in COSTS and cost > 0.0}
    if not limits:
        raise ConfigError(f"{key}.reference: {reference} has recorded no lower-layer cost yet")
    return limits


def _has_limits(optimizer: Mapping[str, Any]) -> bool:
    """Whether an optimizer takes limits of costs, as a mapping or as shares of another run's."""
    return {"limits", "reference", "reference_share"} <= optimizer.keys()


def _initial_file(config: Mapping[str, Any]) -> str | None:
    if config.get(INITIAL) is None:
        return None
    try:
        return str(initial_checkpoint(Path(config[INITIAL]).absolute()))
    except ValueError as error:
        raise ConfigError(f"{INITIAL}: {error}") from error


def _own_keys(config: DictConfig) -> list[str]:
    return [str(key) for key in config if key != "hydra"]


def load_settings(config: DictConfig | Mapping[str, Any]) -> Settings:
    """Check a configuration against the schema and against itself.

    Raises:
        ConfigError: names every wrong key with what is allowed.
    """
    is_hydras = isinstance(config, DictConfig)
    plain = plain_config(config) if is_hydras else copy.deepcopy(dict(config))
    _whole_numbers_to_floats(plain)
    try:
        typed = OmegaConf.merge(OmegaConf.structured(Settings), plain)
        settings: Settings = OmegaConf.to_object(typed)  # type: ignore[assignment]
    except OmegaConfBaseException as error:
        raise ConfigError(_explain_type_error(error)) from None
    problems = [
        *violations(settings),
        *_reward_problems(settings.reward),
        *_fit_problems(settings),
    ]
    if problems:
        raise ConfigError("\n".join(problems))
    return settings


def _whole_numbers_to_floats(plain: dict[str, Any]) -> None:
    """Let ``sigma=2`` mean 2.0: OmegaConf converts no numbers in dictionaries of dictionaries."""
    parameters = plain.get("reward", {}).get("parameters") or {}
    for constants in parameters.values():
        if isinstance(constants, dict):
            constants.update({k: float(v) for k, v in constants.items() if type(v) is int})


# --- checks ----------------------------------------------------------------------------------


def _explain_type_error(error: OmegaConfBaseException) -> str:
    key = error.full_key or ""
    message = str(error.msg or error).splitlines()[0]
    if "not in" in message:
        return no_such_key(key, _schema_keys(key.rpartition(".")[0]))
    if "is not a ListConfig" in message:
        allowed = RANGE if key.startswith("env.disturbance.") else "a list"
        return f"{key} is no list; allowed: {allowed}"
    return f"{key}: {message}"


def _schema_keys(path: str) -> list[str]:
    """The keys of a group. OmegaConf's schema does not tell: without defaults, groups are empty."""
    group: Any = Settings
    for name in filter(None, path.split(".")):
        group = get_type_hints(group).get(name) if is_dataclass(group) else None
    return [field.name for field in fields(group)] if is_dataclass(group) else []


def _reward_problems(reward: RewardSettings) -> Iterator[str]:
    for group, terms in (("goal", reward.goal), ("optimizing", reward.optimizing)):
        for name in terms:
            if name not in TERMS:
                yield (f"reward.{group}.{name} is no reward term; allowed: {', '.join(TERMS)}")
    for name in sorted({*reward.goal} & {*reward.optimizing}):
        yield f"reward.goal.{name} stands in reward.optimizing, too; remove one of them"
    for group, terms in (("goal", reward.goal), ("optimizing", reward.optimizing)):
        for name, coefficient in terms.items():
            if not math.isfinite(coefficient):
                yield f"reward.{group}.{name} is {coefficient}; allowed: a finite number"
    if not reward.goal:
        yield "reward.goal is empty; it needs at least one term, by which trajectories are ranked"
    yield from _shaping_problems(reward)
    for name in (*reward.goal, *reward.optimizing):
        needed = set(TERMS[name].constants if name in TERMS else ())
        given = set(reward.parameters.get(name, {}))
        if needed != given:
            yield f"reward.parameters.{name} has {sorted(given)}; it needs {sorted(needed)}"
    for name, constants in reward.parameters.items():
        if not 0.0 < constants.get("sigma", 1.0) < math.inf:
            yield f"reward.parameters.{name}.sigma is {constants['sigma']}; allowed: above 0"
        if not 0.0 <= constants.get("margin", 0.0) < 1.0:
            yield (
                f"reward.parameters.{name}.margin is {constants['margin']}; "
                "allowed: from 0 to below 1"
            )


def _shaping_problems(reward: RewardSettings) -> Iterator[str]:
    for number, name in enumerate(reward.shaping):
        if name not in STATE_COSTS:
            why = "no cost of the state alone" if name in TERMS else "no reward term"
            yield f"reward.shaping: {name} is {why}; allowed: {', '.join(STATE_COSTS)}"
        elif name not in reward.optimizing:
            yield f"reward.shaping: {name} has no coefficient in reward.optimizing"
        if name in reward.shaping[:number]:
            yield f"reward.shaping: {name} stands there twice"


def _fit_problems(settings: Settings) -> Iterator[str]:
    ppo, termination = settings.ppo, settings.env.termination
    if settings.scale.num_envs * ppo.num_steps < ppo.num_minibatches:
        yield "ppo.num_minibatches exceeds the samples of an iteration (num_envs * num_steps)"
    if not ppo.min_learning_rate <= ppo.learning_rate <= ppo.max_learning_rate:
        yield "ppo.learning_rate must lie from ppo.min_learning_rate to ppo.max_learning_rate"
    if ppo.target_kl is not None and ppo.final_learning_rate is not None:
        yield (
            "ppo.final_learning_rate and ppo.target_kl both say how the learning rate changes; "
            "one of them must be null"
        )
    if termination.distance_end_m > termination.distance_start_m:
        yield "env.termination.distance_end_m exceeds env.termination.distance_start_m"
    if (termination.distance_max_m or math.inf) < termination.distance_start_m:
        yield "env.termination.distance_start_m exceeds env.termination.distance_max_m"
    disturbance = settings.env.disturbance
    if (disturbance.push_m_s is None) != (disturbance.push_every_s is None):
        yield (
            "env.disturbance.push_m_s and env.disturbance.push_every_s go together: how hard, and "
            "how often, such as [0,0.5] and [1,3]"
        )
    yield from _limit_problems(settings.optimizer)
    yield from stage_problems(settings)
    yield from reading_problems(settings)
    for key, name in (("scale.name", settings.scale.name), ("study", settings.study)):
        if not re.fullmatch(r"[\w.-]+", name) or name in (".", ".."):
            yield f"{key} is {name!r}; allowed: letters, digits, '.', '_' and '-'"
    if settings.env.robot.mjcf is not None and not Path(settings.env.robot.mjcf).is_file():
        yield f"env.robot.mjcf: there is no file {settings.env.robot.mjcf}"
    yield from _motion_problems(settings.env.motion)


def _limit_problems(optimizer: Mapping[str, Any], key: str = "optimizer") -> Iterator[str]:
    """Limits of what is no cost. The optimizer passes over limits of terms that it has not."""
    limits = optimizer["limits"] if _has_limits(optimizer) else None
    for name in limits or {}:
        if name not in COSTS:
            allowed = ", ".join(COSTS)
            yield f"{key}.limits.{name} is no term of the lower layer; allowed: {allowed}"
    for name, part in _groups(optimizer):
        yield from _limit_problems(part, f"{key}.{name}")


def _motion_problems(motion: str) -> Iterator[str]:
    authored = motion_names()
    if is_motion_path(motion):
        if not Path(motion).is_file():
            yield f"env.motion: there is no file {motion}"
    elif motion not in authored:
        yield (
            f"env.motion is {motion!r}; allowed: {', '.join(authored)}, or a path that ends in "
            ".yaml or .npz"
        )
