"""Explains a mistake in the overrides of a command line: which key, and what it may be."""

import sys
from collections.abc import Sequence

from hydra import compose, initialize_config_module
from hydra.core.global_hydra import GlobalHydra
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.errors import HydraException
from omegaconf import DictConfig, OmegaConf

from tlr_exp.config.checks import no_such_key
from tlr_exp.errors import UserError
from tlr_exp.machine.terminal import EXIT_WRONG

SWEEP_MARKS = ("+sweep=", "hydra.mode=MULTIRUN")  # besides -m, what makes a command a sweep
OTHER_SWEEPER = (
    "hydra/sweeper: a sweep of tlr-train knows all of its jobs before any starts, and continues "
    "existing runs, which no other sweeper does: leave it out"
)


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
            if "hydra/sweeper" in overridden_keys(overrides):
                raise UserError(OTHER_SWEEPER)
            if is_sweep:
                overrides = [values[0] for values in split_overrides(overrides).values()]
            _compose(overrides)
    except (HydraException, ValueError) as error:
        explained = isinstance(error, HydraException | UserError)
        where = "" if explained else f"in {' '.join(overrides)}: "
        print(f"{where}{error}", file=sys.stderr)
        sys.exit(EXIT_WRONG)


def overridden_keys(overrides: Sequence[str]) -> list[str]:
    """The keys and groups that overrides name, such as ``ppo.gamma`` and ``optimizer``."""
    parsed = OverridesParser.create().parse_overrides(list(overrides))
    return [override.key_or_group for override in parsed]


def split_overrides(overrides: Sequence[str]) -> dict[str, list[str]]:
    """For each key the overrides that its jobs have, one per value; of a key given twice the last.

    Lists (``a=1,2``), ranges, choices and globs are sweeps. Hydra must be initialized.

    Raises:
        UserError: an override that is none, or one without single values, such as an interval.
    """
    loader = GlobalHydra.instance().config_loader()
    try:
        parsed = OverridesParser.create(config_loader=loader).parse_overrides(list(overrides))
    except HydraException as error:
        raise UserError(str(error)) from error
    choices: dict[str, list[str]] = {}
    for override in parsed:
        key = override.get_key_element()
        if not override.is_sweep_override():
            choices[key] = [str(override.input_line)]
        elif override.is_discrete_sweep():
            choices[key] = [f"{key}={value}" for value in override.sweep_string_iterator()]
        else:
            raise UserError(
                f"{override.input_line}: a sweep needs single values, such as {key}=A,B or "
                f"'{key}=range(3)'"
            )
        if not choices[key]:
            raise UserError(f"{override.input_line}: there is nothing that it could mean")
    return choices


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
    loader = GlobalHydra.instance().config_loader()
    for override in parsed:
        if loader.get_group_options(override.key_or_group):
            continue  # of groups Hydra says what there is
        others = [other.input_line for other in parsed if other is not override]
        try:
            config = compose("config", [other for other in others if other is not None])
        except HydraException:
            continue
        parent, _, name = override.key_or_group.rpartition(".")
        node = OmegaConf.select(config, parent) if parent else config
        if isinstance(node, DictConfig) and name not in node and not override.is_add():
            return no_such_key(override.key_or_group, [str(key) for key in node])
    return None
