"""Checks of one value each, which say in one form what was set and what is allowed.

Nothing of the project but its error is imported, so that every room can use them.
"""

import difflib
import math
from collections.abc import Sequence
from typing import Any, TypeGuard

from tlr_exp.errors import UserError


class SettingError(UserError):
    """A setting that cannot be. The message begins with its name.

    Where a part is built from a configuration, ``config/components.py`` puts the part's key before.
    """


def check_choice(name: str, value: Any, allowed: Sequence[Any]) -> None:
    """Refuse a value that is not among the choices.

    Raises:
        SettingError: names the setting, its value and the choices.
    """
    if value not in allowed:
        raise refusal(name, value, ", ".join(map(str, allowed)))


def check_at_least(name: str, value: Any, low: float) -> None:
    """Refuse anything but a finite number of at least ``low``.

    Raises:
        SettingError: names the setting, its value and the limit.
    """
    if not (is_number(value) and low <= value < math.inf):
        raise refusal(name, value, f"at least {low:g}")


def check_above(name: str, value: Any, low: float) -> None:
    """Refuse anything but a finite number above ``low``.

    Raises:
        SettingError: names the setting, its value and the limit.
    """
    if not (is_number(value) and low < value < math.inf):
        raise refusal(name, value, f"above {low:g}")


def check_within(name: str, value: Any, low: float, high: float) -> None:
    """Refuse anything but a number from ``low`` to ``high``.

    Raises:
        SettingError: names the setting, its value and the limits.
    """
    if not (is_number(value) and low <= value <= high):
        raise refusal(name, value, f"from {low:g} to {high:g}")


def check_between(name: str, value: Any, low: float, high: float) -> None:
    """Refuse anything but a number above ``low`` and below ``high``.

    Raises:
        SettingError: names the setting, its value and the limits.
    """
    if not (is_number(value) and low < value < high):
        raise refusal(name, value, f"above {low:g} and below {high:g}")


def refusal(name: str, value: Any, allowed: str) -> SettingError:
    """The error to raise for a setting, in the form that all of them have."""
    return SettingError(f"{name} is {value!r}; allowed: {allowed}")


def no_such_key(key: str, allowed: Sequence[str]) -> str:
    """What to say of a dotted key that there is not; ``allowed``: the names in its place."""
    group, _, name = key.rpartition(".")
    close = difflib.get_close_matches(name, allowed, n=1)
    hint = f" Did you mean {close[0]}?" if close else ""
    place = f"in {group}" if group else "here"
    return f"there is no key {key}.{hint} Allowed {place}: {', '.join(allowed) or 'none'}"


def is_number(value: Any) -> TypeGuard[float]:
    """Whether a value of a configuration is a number: true and false are none."""
    return isinstance(value, int | float) and not isinstance(value, bool)
