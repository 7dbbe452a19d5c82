"""Plain nested configurations by dotted keys, such as "reward.objective.threshold_share"."""

from collections.abc import Iterable, Mapping
from typing import Any


def flat(config: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """A nested configuration as {"a.b.c": value}; lists and empty mappings are values."""
    values: dict[str, Any] = {}
    for name, value in config.items():
        key = f"{prefix}{name}"
        if isinstance(value, Mapping) and value:
            values |= flat(value, f"{key}.")
        else:
            values[key] = value
    return values


def covers(keys: Iterable[str], key: str) -> bool:
    """Whether `key` is one of `keys` or lies in a group that is."""
    return any(key == each or key.startswith(f"{each}.") for each in keys)


def value_at(config: Mapping[str, Any], key: str) -> Any:
    """The value or group at a dotted key; None where there is none."""
    value: Any = config
    for name in key.split("."):
        value = value.get(name) if isinstance(value, Mapping) else None
    return value


def with_value(config: Mapping[str, Any], key: str, value: Any) -> dict[str, Any]:
    """A copy of a plain configuration with another value at a dotted key.

    Groups on the way that are not there, or are no groups, are made.
    """
    name, _, rest = key.partition(".")
    if rest:
        group = config.get(name)
        value = with_value(group if isinstance(group, Mapping) else {}, rest, value)
    return {**config, name: value}


def has_part(part: Mapping[str, Any], class_name: str) -> bool:
    """Whether an exchangeable part (``_target_``), or one inside it, is of a class."""
    inside = [value for value in part.values() if isinstance(value, Mapping)]
    is_it = str(part.get("_target_", "")).rpartition(".")[2] == class_name
    return is_it or any(has_part(each, class_name) for each in inside)
