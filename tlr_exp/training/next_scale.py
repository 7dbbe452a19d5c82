"""Tells what the next larger scale would bring, and how long it would take on this machine."""

import shlex
import statistics
from collections.abc import Mapping, Sequence
from importlib.resources import files
from typing import Any

import yaml

from tlr_exp import keys
from tlr_exp.config.settings import ScaleSettings, Settings

NEEDS_GPU = ("paper",)  # days on a CPU
ON_GPU = ("physics=mjx", "device=cuda")
ITERATION_S = f"{keys.TIME_PREFIX}iteration_s"


def next_step(
    settings: Settings, metrics: Sequence[Mapping[str, float]], overrides: Sequence[str]
) -> str | None:
    """A sentence with the command of the next scale, for the end of a training.

    Args:
        settings: of the run.
        metrics: its lines, one an iteration.
        overrides: what its command said.

    None where there is nothing to say: the largest scale, or one that is no file of ``conf/scale``.
    """
    larger = next_scale(settings.scale, known_scales())
    if larger is None or not metrics:
        return None
    name, evidence = larger["name"], larger["evidence"]
    arguments = [word for word in overrides if not _is_scale(word)]
    if name in NEEDS_GPU and settings.device == "cpu":
        rest = [word for word in arguments if not word.startswith(("physics", "device="))]
        return f"{_command(rest, name, *ON_GPU)}  (needs an NVIDIA GPU): {evidence}"
    per_iteration = settings.scale.num_envs * settings.ppo.num_steps
    steps = larger["num_envs"] * larger["iterations"] * settings.ppo.num_steps
    seconds = steps * seconds_per_step([row[ITERATION_S] for row in metrics], per_iteration)
    told = about(seconds)
    return f"{_command(arguments, name)}  ({told} on this machine): {evidence}"


def next_scale(
    scale: ScaleSettings, known: Sequence[Mapping[str, Any]]
) -> Mapping[str, Any] | None:
    """The smallest of the ``known`` that is larger than ``scale``, by control steps.

    None for the largest, and for a scale that is none of them: what it is for is not known.
    """
    sizes = {each["name"]: (each["num_envs"], each["iterations"]) for each in known}
    if sizes.get(scale.name) != (scale.num_envs, scale.iterations):
        return None
    ours = scale.num_envs * scale.iterations
    larger = [each for each in known if each["num_envs"] * each["iterations"] > ours]
    return min(larger, key=lambda each: each["num_envs"] * each["iterations"], default=None)


def seconds_per_step(iteration_s: Sequence[float], steps_per_iteration: int) -> float:
    """Seconds a control step takes: the median of the later half of the iterations.

    The first ones compile and warm up; the median passes over those that evaluate, too.
    """
    later = iteration_s[len(iteration_s) // 2 :]
    return statistics.median(later) / steps_per_iteration


def about(seconds: float) -> str:
    """A time to plan with: about 50 s, about 27 min, about 5 h."""
    if seconds < 90:
        return f"about {seconds:.0f} s"
    if seconds < 2 * 3600:
        return f"about {seconds / 60:.0f} min"
    return f"about {seconds / 3600:.0f} h"


def known_scales() -> list[dict[str, Any]]:
    """The files of ``conf/scale``."""
    folder = files("tlr_exp.conf").joinpath("scale").iterdir()
    return [
        yaml.safe_load(file.read_text(encoding="utf-8"))
        for file in folder
        if file.name.endswith(".yaml")
    ]


def _is_scale(override: str) -> bool:
    return override.lstrip("+~").startswith(("scale=", "scale."))


def _command(arguments: Sequence[str], scale: str, *more: str) -> str:
    return shlex.join(["tlr-train", *arguments, f"scale={scale}", *more])
