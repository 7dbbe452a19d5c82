"""Explains a mistake in the overrides of a command line: which key, and what it may be."""

import difflib
import sys
from collections.abc import Sequence

from hydra import compose, initialize_config_module
from hydra.core.global_hydra import GlobalHydra
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.core.override_parser.types import Override
from hydra.errors import HydraException
from omegaconf import DictConfig, OmegaConf

from tlr_exp.machine.terminal import EXIT_WRONG

SWEEP_MARKS = ("+sweep=", "hydra.mode=MULTIRUN")  # besides -m, what makes a command a sweep


def explain_mistakes(arguments: Sequence[str]) -> None:
    """Leave with an explanation where ``arguments`` hold an override that cannot be composed.

    Hydra names the key but not what is there in its place. Of a sweep one job is looked at, with
    the first of each key's values; `tlr_exp.sweeps.plan` looks at all. Flags are Hydra's to judge.
    """
    flags = {argument for argument in arguments if argument.startswith("-")}
    if flags - {"-m", "--multirun"}:
        return
    overrides = [argument for argument in arguments if argument not in flags]
    is_sweep = bool(flags) or any(override.startswith(SWEEP_MARKS) for override in overrides)
    try:
        with initialize_config_module("tlr_exp.conf", version_base="1.3"):
            if is_sweep:
                overrides = _first_values(overrides)
            _compose(overrides)
    except (HydraException, ValueError) as error:
        where = "" if isinstance(error, HydraException) else f"in {' '.join(overrides)}: "
        print(f"{where}{error}", file=sys.stderr)
        sys.exit(EXIT_WRONG)


def overridden_keys(overrides: Sequence[str]) -> list[str]:
    """The keys and groups that overrides name, such as ``ppo.gamma`` and ``optimizer``."""
    parsed = OverridesParser.create().parse_overrides(list(overrides))
    return [override.key_or_group for override in parsed]


def _first_values(overrides: Sequence[str]) -> list[str]:
    """Of each sweep of values the first: ``seed=0,1`` and ``seed=range(2)`` become ``seed=0``."""
    loader = GlobalHydra.instance().config_loader()
    parsed = OverridesParser.create(config_loader=loader).parse_overrides(list(overrides))
    return [_first_value(override) for override in parsed]


def _first_value(override: Override) -> str:
    if override.is_sweep_override() and override.is_discrete_sweep():
        for value in override.sweep_string_iterator():
            return f"{override.get_key_element()}={value}"
    return str(override.input_line)


def _compose(overrides: list[str]) -> None:
    try:
        compose("config", overrides)
    except HydraException as error:
        hint = _unknown_key(overrides)
        if hint is None:
            raise
        raise HydraException(hint) from error


def _unknown_key(overrides: Sequence[str]) -> str | None:
    """What to say where one of ``overrides`` names a key that the others' configuration lacks."""
    parsed = OverridesParser.create().parse_overrides(list(overrides))
    for override in parsed:
        others = [other.input_line for other in parsed if other is not override]
        try:
            config = compose("config", [other for other in others if other is not None])
        except HydraException:
            continue
        parent, _, name = override.key_or_group.rpartition(".")
        node = OmegaConf.select(config, parent) if parent else config
        if isinstance(node, DictConfig) and name not in node and not override.is_add():
            allowed = [str(key) for key in node]
            close = difflib.get_close_matches(name, allowed, n=1)
            hint = f" Did you mean {close[0]}?" if close else ""
            return (
                f"there is no key {override.key_or_group}.{hint} "
                f"Allowed {f'in {parent}' if parent else 'here'}: {', '.join(allowed)}"
            )
    return None
