"""Checks of one value each, which say in one form what was set and what is allowed."""

import math
from collections.abc import Sequence
from typing import Any

from tlr_exp.errors import UserError


def check_choice(name: str, value: Any, allowed: Sequence[Any]) -> None:
    """Refuse a value that is not among the choices.

    Raises:
        UserError: names the setting, its value and the choices.
    """
    if value not in allowed:
        raise _refusal(name, value, ", ".join(map(str, allowed)))


def check_at_least(name: str, value: Any, low: float) -> None:
    """Refuse anything but a finite number of at least ``low``.

    Raises:
        UserError: names the setting, its value and the limit.
    """
    if not (_is_number(value) and low <= value < math.inf):
        raise _refusal(name, value, f"at least {low:g}")


def check_above(name: str, value: Any, low: float) -> None:
    """Refuse anything but a finite number above ``low``.

    Raises:
        UserError: names the setting, its value and the limit.
    """
    if not (_is_number(value) and low < value < math.inf):
        raise _refusal(name, value, f"above {low:g}")


def check_within(name: str, value: Any, low: float, high: float) -> None:
    """Refuse anything but a number from ``low`` to ``high``.

    Raises:
        UserError: names the setting, its value and the limits.
    """
    if not (_is_number(value) and low <= value <= high):
        raise _refusal(name, value, f"from {low:g} to {high:g}")


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _refusal(name: str, value: Any, allowed: str) -> UserError:
    return UserError(f"{name} is {value!r}; allowed: {allowed}")
