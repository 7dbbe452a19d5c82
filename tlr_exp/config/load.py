"""From Hydra's configuration to checked ``Settings``: types, allowed values, what fits together.

Hydra and OmegaConf stay within this file and the entry points. Nothing heavy is imported, so
that a mistake shows within a second or two.
"""

import copy
import difflib
import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import fields, is_dataclass
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Any, get_type_hints

from hydra.errors import InstantiationException
from hydra.utils import instantiate as hydra_instantiate
from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import OmegaConfBaseException

from tlr_exp import keys
from tlr_exp.config.input_files import INITIAL, is_motion_path
from tlr_exp.config.limits import violations
from tlr_exp.config.settings import RewardSettings, Settings
from tlr_exp.motion.clips import motion_names
from tlr_exp.records.checkpoint_files import initial_checkpoint
from tlr_exp.records.final_metrics import final_terms
from tlr_exp.records.run_directory import RunDirectory, RunDirectoryError

CONFIG_PATH = "pkg://tlr_exp.conf"


class ConfigError(ValueError):
    """The configuration is wrong; each line names a key and what is allowed."""


def plain_config(config: DictConfig) -> dict[str, Any]:
    """The resolved configuration as plain data, without Hydra's own part."""
    return OmegaConf.to_container(OmegaConf.masked_copy(config, _own_keys(config)), resolve=True)  # type: ignore[return-value]


def with_absolute_paths(config: Mapping[str, Any]) -> dict[str, Any]:
    """A plain configuration that means the same files whenever and wherever it is read again.

    A run to begin from becomes the checkpoint of it that is the best one now; a run whose costs are
    limits becomes these limits.

    Raises:
        ConfigError: there is no run or checkpoint to begin from, or no run to take limits from.
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


def _with_limits(optimizer: Mapping[str, Any]) -> Mapping[str, Any]:
    """An optimizer whose limits, where ``reference`` names a run, are shares of that run's costs.

    A cost that the run does not have gets no limit.
    """
    reference = optimizer.get("reference")
    if reference is None:
        return optimizer
    try:
        costs = final_terms(RunDirectory.open(Path(str(reference))).metrics())
    except RunDirectoryError as error:
        raise ConfigError(f"optimizer.reference: {error}") from error
    share = optimizer["reference_share"]
    limits = {
        name: share * cost
        for name, cost in costs.items()
        if name in keys.LOWER_LAYER_TERMS and cost > 0.0
    }
    if not limits:
        raise ConfigError(f"optimizer.reference: {reference} has recorded no lower-layer cost yet")
    return {**optimizer, "limits": limits, "reference": None, "reference_share": 1.0}


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
        *_component_types(plain),
        *violations(plain),
        *_reward_problems(settings.reward),
        *_fit_problems(settings),
    ]
    if problems:
        raise ConfigError("\n".join(problems))
    return settings


def instantiate(node: Mapping[str, Any], **arguments: Any) -> Any:
    """Build the object that ``_target_`` of a configuration node names.

    Raises:
        ConfigError: there is no such class, or it refuses its settings.
    """
    # In two steps, because Hydra would turn ``arguments`` into configurations of its own.
    try:
        build = hydra_instantiate(OmegaConf.create(dict(node)), _partial_=True)
    except InstantiationException as error:
        raise ConfigError(f"{node.get('_target_')}: {error.__cause__ or error}") from error
    try:
        return build(**arguments)
    except (TypeError, ValueError) as error:
        raise ConfigError(f"{node.get('_target_')}: {error}") from error


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
    parent, _, name = key.rpartition(".")
    if "not in" in message:
        siblings = _schema_keys(parent)
        close = difflib.get_close_matches(name, siblings, n=1)
        hint = f" Did you mean {close[0]}?" if close else ""
        return f"there is no key {key}.{hint} Allowed here: {', '.join(siblings)}"
    return f"{key}: {message}"


def _schema_keys(path: str) -> list[str]:
    """The keys of a group. OmegaConf's schema does not tell: without defaults, groups are empty."""
    group: Any = Settings
    for name in filter(None, path.split(".")):
        group = get_type_hints(group).get(name) if is_dataclass(group) else None
    return [field.name for field in fields(group)] if is_dataclass(group) else []


def _component_types(config: Mapping[str, Any]) -> Iterator[str]:
    """Settings of exchangeable parts whose type differs from that in the part's own YAML file."""
    for group, node in _components(config):
        target = node.get("_target_")
        if not isinstance(target, str):
            yield f"{group}._target_ is {target!r}; it must name a class"
            continue
        standard = _standard_settings(group, target)
        for name, value in node.items():
            if name in standard and not _same_type(value, standard[name]):
                kind = type(standard[name]).__name__
                yield f"{group}.{name} is {value!r}; it must be of type {kind}"


def _components(config: Mapping[str, Any]) -> Iterator[tuple[str, Mapping[str, Any]]]:
    yield "physics", config["physics"]
    yield "optimizer", config["optimizer"]
    yield "reward.objective", config["reward"]["objective"]


@cache  # a sweep asks once for each of its jobs
def _standard_settings(group: str, target: str) -> Mapping[str, Any]:
    for path in sorted(_conf(group.replace(".", "/")).glob("*.yaml")):
        content = OmegaConf.to_container(OmegaConf.load(path))
        if isinstance(content, dict) and content.get("_target_") == target:
            return {str(key): value for key, value in content.items()}
    return {}


def _conf(folder: str) -> Path:
    return Path(str(files("tlr_exp.conf").joinpath(folder)))


def _same_type(value: Any, standard: Any) -> bool:
    if standard is None or value is None:
        return True
    if isinstance(standard, float):
        return isinstance(value, int | float) and not isinstance(value, bool)
    return type(value) is type(standard)


def _reward_problems(reward: RewardSettings) -> Iterator[str]:
    for group, terms in (("goal", reward.goal), ("optimizing", reward.optimizing)):
        for name in terms:
            if name not in keys.TERM_NAMES:
                yield (
                    f"reward.{group}.{name} is no reward term; allowed: "
                    f"{', '.join(keys.TERM_NAMES)}"
                )
    for name in sorted({*reward.goal} & {*reward.optimizing}):
        yield f"reward.goal.{name} stands in reward.optimizing, too; remove one of them"
    for group, terms in (("goal", reward.goal), ("optimizing", reward.optimizing)):
        for name, coefficient in terms.items():
            if not math.isfinite(coefficient):
                yield f"reward.{group}.{name} is {coefficient}; allowed: a finite number"
    if not reward.goal:
        yield "reward.goal is empty; it needs at least one term, by which trajectories are ranked"
    for name in (*reward.goal, *reward.optimizing):
        needed = set(keys.TERM_PARAMETERS.get(name, ()))
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
    lower, upper = settings.optimizer.get("lower"), settings.optimizer.get("upper")
    if isinstance(lower, int | float) and isinstance(upper, int | float) and lower >= upper:
        yield f"optimizer.lower is {lower}; allowed: below optimizer.upper, which is {upper}"
    yield from _limit_problems(settings.optimizer.get("limits"))
    for key, name in (("scale.name", settings.scale.name), ("study", settings.study)):
        if not re.fullmatch(r"[\w.-]+", name) or name in (".", ".."):
            yield f"{key} is {name!r}; allowed: letters, digits, '.', '_' and '-'"
    share = settings.reward.objective.get("threshold_share")
    if isinstance(share, float) and 0.0 < share < 1.0 and share * settings.scale.num_envs < 1.0:
        yield (
            f"reward.objective.threshold_share {share:g} of scale.num_envs "
            f"{settings.scale.num_envs} leaves no candidate; use more environments"
        )
    if settings.env.robot.mjcf is not None and not Path(settings.env.robot.mjcf).is_file():
        yield f"env.robot.mjcf: there is no file {settings.env.robot.mjcf}"
    yield from _motion_problems(settings.env.motion)


def _limit_problems(limits: Any) -> Iterator[str]:
    for name, limit in (limits or {}).items():
        if name not in keys.LOWER_LAYER_TERMS:
            allowed = ", ".join(keys.LOWER_LAYER_TERMS)
            yield f"optimizer.limits.{name} is no term of the lower layer; allowed: {allowed}"
        elif isinstance(limit, bool) or not isinstance(limit, int | float) or not limit > 0:
            yield f"optimizer.limits.{name} is {limit!r}; allowed: a number above 0"


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
