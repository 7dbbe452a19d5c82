"""Tells which runs belong together: the method, and the settings in which its runs differ."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from tlr_exp.config.identity import NOT_IDENTITY
from tlr_exp.config.input_files import is_motion_path
from tlr_exp.config.nested import covers, flat
from tlr_exp.config.versions import of_any_version
from tlr_exp.records.run_directory import RunDirectory

# Not part of an arm: a run of an arm has a seed of its own, and the motion is told apart from it.
_ASIDE = (*NOT_IDENTITY, "seed", "device", "env.motion", "scale.name")


def arms_of(runs: Sequence[RunDirectory]) -> list[str]:
    """What to call the arm of each run: "gwo", or "gwo, penalty_scale=0.5" where runs differ.

    Named are the settings that differ between runs of the same method, but for those in which runs
    may differ and still be of one arm.

    Raises:
        RunDirectoryError: a manifest or a configuration cannot be read.
    """
    methods = [run.manifest.get("tags", {}).get("method") or run.path.name for run in runs]
    settings = [_settings(run) for run in runs]
    differing = {method: _differing(settings, methods, method) for method in methods}
    return [
        ", ".join([method, *(_part(key, own[key]) for key in differing[method] if key in own)])
        for method, own in zip(methods, settings, strict=True)
    ]


def motion_name(motion: str) -> str:
    """What a motion is called in a table: a file by its name, without its folder."""
    return Path(motion).name if is_motion_path(motion) else motion


def _settings(run: RunDirectory) -> dict[str, Any]:
    return {
        key: value
        for key, value in flat(of_any_version(run.config)).items()
        if value != {} and not covers(_ASIDE, key)
    }


def _differing(
    settings: Sequence[Mapping[str, Any]], methods: Sequence[str], method: str
) -> list[str]:
    own = [each for each, name in zip(settings, methods, strict=True) if name == method]
    names = dict.fromkeys(key for each in own for key in each)
    return [key for key in names if any(each.get(key) != own[0].get(key) for each in own)]


def _part(key: str, value: Any) -> str:
    """What a label says of a setting: penalty_scale=0.5, or for a part its class."""
    group, _, name = key.rpartition(".")
    if name == "_target_":
        name, value = group.rpartition(".")[2], str(value).rpartition(".")[2]
    return f"{name}={value}"
