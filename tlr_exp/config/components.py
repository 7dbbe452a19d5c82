"""The exchangeable parts: what ``_target_`` names, built from settings that fit its arguments.

A part says by its signature what its settings are called and of which types, and checks itself
what they may be. Here the keys are added to what it says: nothing is known of any part, so that one
of the user's own is treated like the others.
"""

from collections.abc import Callable, Mapping
from typing import Any

from hydra.errors import InstantiationException
from hydra.utils import instantiate as hydra_instantiate

from tlr_exp.config.checks import SettingError
from tlr_exp.config.load import ConfigError
from tlr_exp.config.signatures import argument_problems

TARGET, PARTIAL = "_target_", "_partial_"


def instantiate(key: str, node: Mapping[str, Any], /, **arguments: Any) -> Any:
    """The part that ``_target_`` of a configuration node names, built from the node's settings.

    Nodes within it are built first; with ``_partial_: true`` the function that builds one is handed
    over in its place.

    Args:
        key: where the node stands in the configuration.
        node: ``_target_`` and settings.
        arguments: what the part is given besides.

    Raises:
        ConfigError: there is no such part, it has no place for what it would be given, or it
            refuses its settings. Any other error is a mistake of the part.
    """
    return _builder(key, node)(**arguments)


def check_component(key: str, node: Mapping[str, Any], /, **arguments: Any) -> None:
    """Refuse what ``instantiate`` would refuse, for a part that takes long to build.

    What its settings may be is asked of its ``check_settings``, where it has one.

    Raises:
        ConfigError: as ``instantiate``.
    """
    part, settings = part_of(key, node), _settings(key, node)
    _check_arguments(key, part, settings, arguments)
    if hasattr(part, "check_settings"):
        _called(key, part.check_settings, settings)


def _builder(key: str, node: Mapping[str, Any]) -> Callable[..., Any]:
    part, settings = part_of(key, node), _settings(key, node)

    def build(**arguments: Any) -> Any:
        _check_arguments(key, part, settings, arguments)
        return _called(key, part, {**settings, **arguments})

    return build


def part_of(key: str, node: Mapping[str, Any]) -> Any:
    """The class or function that a node names.

    Raises:
        ConfigError: it names none.
    """
    target = node.get(TARGET)
    if not isinstance(target, str):
        raise ConfigError(f"{key}.{TARGET} is {target!r}; it must name a class")
    try:
        # Hydra finds it, and does not build it: it would turn arguments into configurations.
        return hydra_instantiate({TARGET: target, PARTIAL: True}).func
    except InstantiationException as error:
        raise ConfigError(f"{key}.{TARGET} is {target}: {error.__cause__ or error}") from error


def _settings(key: str, node: Mapping[str, Any]) -> dict[str, Any]:
    """The settings of a node, by name, with the parts within it built."""
    names = [name for name in node if name not in (TARGET, PARTIAL)]
    return {name: _setting(f"{key}.{name}", node[name]) for name in names}


def _setting(key: str, value: Any) -> Any:
    if isinstance(value, list):
        return [_setting(f"{key}.{num}", each) for num, each in enumerate(value)]
    if not isinstance(value, Mapping):
        return value
    if TARGET not in value:
        return _settings(key, value)
    build = _builder(key, value)
    return build if value.get(PARTIAL) else build()


def _check_arguments(
    key: str, part: Callable[..., Any], settings: Mapping[str, Any], arguments: Mapping[str, Any]
) -> None:
    problems = argument_problems(key, part, settings, arguments)
    if problems:
        raise ConfigError("\n".join(problems))


def _called(key: str, function: Callable[..., Any], arguments: Mapping[str, Any]) -> Any:
    """What a function of a part gives; what it refuses is told by its key."""
    try:
        return function(**arguments)
    except ConfigError:  # of a part within, which has told its own
        raise
    except SettingError as error:
        raise ConfigError(f"{key}.{error}") from error
    except ValueError as error:
        raise ConfigError(f"{key}: {error}") from error
