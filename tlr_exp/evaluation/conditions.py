"""What is done to robots in an evaluation under disturbance: one condition for each row of a grid.

On the command line a condition is ``push=0.5``, several are ``delay=20,40``, and what happens
together is joined by a plus: ``mass=1.1+friction=0.5``. docs/disturbances.md explains the names.
"""

from __future__ import annotations

import dataclasses
import itertools
import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import Any

import yaml

from tlr_exp.config.checks import refusal
from tlr_exp.config.limits import LIMITS
from tlr_exp.config.settings import EnvSettings, ObservationNoise
from tlr_exp.errors import UserError
from tlr_exp.robot.timing import CONTROL_DT_S

EVERY_S = [1.0, 3.0]  # time between pushes unless push_every says otherwise; BeyondMimic's


@dataclass(frozen=True)
class _Kind:
    """A disturbance by its name on the command line: the key in ``env`` and its unit."""

    key: str
    unit: str = ""  # none for factors and coefficients


# A number is a range without width: every robot gets it.
_RANGES = {
    "push": _Kind("disturbance.push_m_s", "m/s"),
    "push_every": _Kind("disturbance.push_every_s", "s"),
    "friction": _Kind("disturbance.friction"),
    "mass": _Kind("disturbance.mass"),
    "com": _Kind("disturbance.com_m", "m"),
    "kp": _Kind("disturbance.kp"),
    "kd": _Kind("disturbance.kd"),
    "armature": _Kind("disturbance.armature"),
}
# Half-widths of noise on the starting state.
_STARTS = {
    "start_root_pos": _Kind("reset_noise.root_pos_m", "m"),
    "start_root_rot": _Kind("reset_noise.root_rot_rad", "rad"),
    "start_root_lin_vel": _Kind("reset_noise.root_lin_vel", "m/s"),
    "start_root_ang_vel": _Kind("reset_noise.root_ang_vel", "rad/s"),
    "start_joint_pos": _Kind("reset_noise.joint_pos_rad", "rad"),
    "start_joint_vel": _Kind("reset_noise.joint_vel", "rad/s"),
}
_DELAY = _Kind("disturbance.delay_steps", "ms")
_NOISE = "noise"  # a choice of conf/env/noise
NAMES = (*_RANGES, "delay", _NOISE, *_STARTS)


@dataclass(frozen=True)
class Condition:
    """What is done to robots; ``changes`` are keys in ``env`` with their values.

    Two conditions have the same ``label`` only where they are the same: records are found by it.
    """

    label: str
    changes: tuple[tuple[str, Any], ...] = ()

    @property
    def file_part(self) -> str:
        """What files are called by: push-0.5, or nothing where nothing is done."""
        return re.sub(r"[^\w.]+", "-", self.label) if self.changes else ""

    def applied(self, settings: EnvSettings) -> EnvSettings:
        """Settings of an environment with it; those given stay as they are."""
        for key, value in self.changes:
            if key == _NOISE:
                settings = dataclasses.replace(settings, noise=value)
                continue
            group, name = key.split(".")
            changed = dataclasses.replace(getattr(settings, group), **{name: value})
            settings = dataclasses.replace(settings, **{group: changed})
        return settings


UNDISTURBED = Condition("none")


def conditions(texts: Sequence[str]) -> list[Condition]:
    """The rows of a grid, the undisturbed one first, each once.

    Raises:
        UserError: an unknown name, or a value that cannot be; says what is allowed.
    """
    found = {UNDISTURBED.label: UNDISTURBED}
    for text in texts:
        parts = [_values(text, part) for part in text.split("+")]
        for chosen in itertools.product(*parts):
            condition = _together(text, chosen)
            found[condition.label] = condition
    return list(found.values())


def _values(text: str, part: str) -> list[tuple[str, str]]:
    """Names with one value each: delay=20,40 are two."""
    name, equals, values = part.partition("=")
    if name not in NAMES or not equals:
        raise UserError(
            f"--disturb {text}: {part!r} is no disturbance; allowed: NAME=VALUE or "
            f"NAME=VALUE,VALUE with a NAME of {', '.join(NAMES)}"
        )
    return [(name, value) for value in values.split(",")]


def _together(text: str, chosen: Sequence[tuple[str, str]]) -> Condition:
    names = [name for name, _ in chosen]
    if len(set(names)) < len(names):
        raise UserError(f"--disturb {text}: a name stands in it twice")
    if "push_every" in names and "push" not in names:
        raise UserError(f"--disturb {text}: push_every needs push, as in push=0.5+push_every=2")
    chosen = sorted(chosen, key=lambda pair: NAMES.index(pair[0]))  # however it was written
    changes: dict[str, Any] = {"disturbance.push_every_s": EVERY_S} if "push" in names else {}
    labels = []
    for name, value in chosen:
        label, key, setting = _change(text, name, value)
        changes[key] = setting
        labels.append(f"{name}={label}")
    return Condition("+".join(labels), tuple(changes.items()))


def _change(text: str, name: str, value: str) -> tuple[str, str, Any]:
    """What a value is called, its key and what it is there."""
    if name == _NOISE:
        return value, _NOISE, _noise(text, value)
    if name == "delay":
        milliseconds = _number(text, name, value, _DELAY)
        steps = milliseconds / (1000.0 * CONTROL_DT_S)
        if steps != round(steps):
            raise UserError(
                f"--disturb {text}: a delay is whole control steps of "
                f"{1000.0 * CONTROL_DT_S:g} ms, such as 20 or 40"
            )
        setting = _allowed(text, _DELAY.key, [round(steps)] * 2)
        return f"{_digits(milliseconds)}ms", _DELAY.key, setting
    kind = (_RANGES | _STARTS)[name]
    number = _number(text, name, value, kind)
    setting = [number, number] if name in _RANGES else number
    return _digits(number), kind.key, _allowed(text, kind.key, setting)


def _number(text: str, name: str, value: str, kind: _Kind) -> float:
    try:
        number = float(value.removesuffix(kind.unit))
    except ValueError:
        number = math.nan
    if not math.isfinite(number):
        unit = f", in {kind.unit}" if kind.unit else ""
        raise UserError(f"--disturb {text}: {refusal(name, value, f'a finite number{unit}')}")
    return number


def _digits(number: float) -> str:
    """All digits that tell a number from others, without the plus that joins conditions."""
    return repr(number).removesuffix(".0").replace("e+", "e")


def _allowed(text: str, key: str, value: Any) -> Any:
    """The value, if the configuration would take it, too."""
    try:
        LIMITS[f"env.{key}"](f"env.{key}", value)
    except UserError as error:
        raise UserError(f"--disturb {text}: {error}") from error
    return value


def _noise(text: str, name: str) -> ObservationNoise:
    """The noise of a file in ``conf/env/noise``."""
    folder = files("tlr_exp.conf").joinpath("env", "noise")
    names = sorted(Path(file.name).stem for file in folder.iterdir() if file.name.endswith(".yaml"))
    if name not in names:
        raise UserError(f"--disturb {text}: noise={name}; allowed: {', '.join(names)}")
    values: dict[str, Any] = {}
    for each in ("none", name):  # what all of them begin with
        values |= yaml.safe_load(folder.joinpath(f"{each}.yaml").read_text(encoding="utf-8"))
    values.pop("defaults", None)
    return ObservationNoise(**values)
