"""Explains a mistake in the overrides of a command line: which key, and what it may be."""

import difflib
import sys
from collections.abc import Sequence

from hydra import compose, initialize_config_module
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.errors import HydraException
from omegaconf import DictConfig, OmegaConf

EXIT_CONFIG = 2


def explain_mistakes(arguments: Sequence[str]) -> None:
    """Leave with an explanation where ``arguments`` hold an override that cannot be composed.

    Hydra names the key but not what is there in its place. Everything else (flags, sweeps of
    several values, interpolations) is Hydra's own to judge.
    """
    flags = {argument for argument in arguments if argument.startswith("-")}
    if flags - {"-m", "--multirun"}:
        return
    overrides = [_first_value(a) if flags else a for a in arguments if a not in flags]
    try:
        with initialize_config_module("tlr_exp.conf", version_base="1.3"):
            _compose(overrides)
    except (HydraException, ValueError) as error:
        where = "" if isinstance(error, HydraException) else f"in {' '.join(overrides)}: "
        print(f"{where}{error}", file=sys.stderr)
        sys.exit(EXIT_CONFIG)


def _first_value(override: str) -> str:
    """Of a plain list of values in a sweep, the first: ``seed=0,1`` is checked as ``seed=0``."""
    key, equals, values = override.partition("=")
    plain = not any(bracket in values for bracket in "([{'\"")
    return f"{key}{equals}{values.split(',')[0]}" if plain else override


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
