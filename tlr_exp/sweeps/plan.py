"""From Hydra's configuration of a sweep to its jobs: all composed and checked before any starts."""

import itertools
import json
from collections.abc import Callable, Sequence
from functools import partial
from importlib.resources import files
from pathlib import Path
from typing import Any

from hydra import compose
from hydra.errors import HydraException
from omegaconf import DictConfig, OmegaConf

from tlr_exp.config.identity import run_identity
from tlr_exp.config.input_files import INITIAL
from tlr_exp.config.load import (
    ConfigError,
    load_settings,
    plain_config,
    with_absolute_paths,
)
from tlr_exp.config.overrides import split_overrides
from tlr_exp.config.settings import Settings
from tlr_exp.errors import UserError
from tlr_exp.machine.cores import available_cores
from tlr_exp.records.runs import config_hash
from tlr_exp.sweeps.parallel import parallelism
from tlr_exp.sweeps.spec import JobSpec, Plan, with_threads
from tlr_exp.training.resuming import is_run
from tlr_exp.training.run import check_beginning, check_lower_layer, check_world, tracking_uri

UNNAMED = "multirun"
SHARED = ("study", "runs_dir", "tracking_uri", "resume")  # of the sweep, so the same in every job

_NOT_IN_SWEEPS = (
    "resume={0} continues that one run, but a sweep has its own runs: leave out -m, or leave out "
    "resume, since a sweep continues its runs by default"
)


def make_plan(config: DictConfig) -> Plan:
    """The jobs that Hydra's multirun configuration asks for, each composed and checked.

    Raises:
        ConfigError: names for every mistake the jobs that have it.
    """
    hydra = config.hydra
    choices = _choices(hydra)
    everything = [tuple(combination) for combination in itertools.product(*choices.values())]
    launcher = OmegaConf.to_container(hydra.launcher, resolve=True)
    how = parallelism(launcher, len(everything), available_cores())  # type: ignore[arg-type]
    differing = [key for key, values in choices.items() if len(values) > 1]
    labels = [_label(overrides, differing) for overrides in everything]
    composed = _compose_all(hydra, everything, labels)
    shared = _check_all(composed, labels, check_device=not how.detached)
    specs = (
        JobSpec(num, plain, method, everything[num], labels[num], run_identity(plain))
        for num, (plain, _, method) in enumerate(composed)
    )
    jobs = tuple(with_threads(spec, how.threads) for spec in specs)
    _refuse_duplicates(jobs)
    identities = [job.identity for job in jobs]
    return Plan(
        name=hydra.runtime.choices.get("sweep") or UNNAMED,
        sweep_id=config_hash({"study": shared.study, "jobs": identities}),
        study=shared.study,
        study_folder=Path(shared.runs_dir).absolute() / shared.study,
        description=_description(hydra),
        arms=tuple(key.lstrip("+") for key in differing if key.lstrip("+") != "seed"),
        scale=shared.scale.name,
        jobs=jobs,
        parallelism=how,
        uri=tracking_uri(shared),
    )


def _choices(hydra: DictConfig) -> dict[str, list[str]]:
    """For each key the overrides that its jobs have, those of a preset before the command's."""
    preset = [f"{key}={value}" for key, value in (hydra.sweeper.params or {}).items()]
    try:
        return split_overrides([*preset, *(str(override) for override in hydra.overrides.task)])
    except UserError as error:
        raise ConfigError(str(error)) from error


def _label(overrides: Sequence[str], differing: Sequence[str]) -> str:
    """The overrides that distinguish a job from the others; for a single job, all of them."""
    told = [o for o in overrides if o.partition("=")[0] in differing]
    return " ".join(override.lstrip("+") for override in told or overrides) or "as configured"


# --- composing and checking ------------------------------------------------------------------
Composed = tuple[dict[str, Any], Settings, str]  # plain configuration, settings, optimizer


def _compose_all(
    hydra: DictConfig, everything: Sequence[Sequence[str]], labels: Sequence[str]
) -> list[Composed]:
    mistakes = Mistakes(labels)
    composed = []
    for num, overrides in enumerate(everything):
        try:
            one = compose(
                hydra.job.config_name,
                [*hydra.overrides.hydra, *overrides],
                return_hydra_config=True,
            )
            load_settings(one)  # or paths would be looked for in what is no path
            plain = with_absolute_paths(plain_config(one))
            composed.append((plain, load_settings(plain), one.hydra.runtime.choices["optimizer"]))
        except (HydraException, ConfigError) as error:
            mistakes.add(num, error)
    mistakes.raise_any()
    return composed


def _check_all(composed: Sequence[Composed], labels: Sequence[str], check_device: bool) -> Settings:
    """Try each motion, model, lower layer and beginning once; the settings of the first job.

    All jobs share those named in SHARED.
    """
    mistakes = Mistakes(labels)
    checked: dict[str, Exception | None] = {}
    first = composed[0][1]
    for num, (plain, settings, _) in enumerate(composed):
        starts = plain["scale"]["evaluate_starts"]
        world = {key: plain[key] for key in ("env", "physics", "device")} | {"starts": starts}
        mistakes.add(num, _mistake(world, partial(check_world, settings, check_device), checked))
        num_envs = settings.scale.num_envs
        layer = {"optimizer": plain["optimizer"], "reward": plain["reward"], "envs": num_envs}
        mistakes.add(num, _mistake(layer, partial(check_lower_layer, settings), checked))
        start = {key: plain[key] for key in (INITIAL, "env", "ppo")}
        mistakes.add(num, _mistake(start, partial(check_beginning, settings), checked))
        if is_run(settings.resume):
            mistakes.add(num, ConfigError(_NOT_IN_SWEEPS.format(settings.resume)))
        for name in SHARED:
            if getattr(settings, name) != getattr(first, name):
                mistakes.add(num, ConfigError(f"{name} must be the same in every job of a sweep"))
    mistakes.raise_any()
    return first


def _mistake(
    part: dict[str, Any], check: Callable[[], object], checked: dict[str, Exception | None]
) -> Exception | None:
    """The mistakes in this part of a configuration; jobs that share it have it checked once."""
    key = json.dumps(part, sort_keys=True)
    if key not in checked:
        try:
            check()
            checked[key] = None
        except ConfigError as error:
            checked[key] = error
    return checked[key]


def _refuse_duplicates(jobs: Sequence[JobSpec]) -> None:
    seen: dict[str, JobSpec] = {}
    for job in jobs:
        other = seen.setdefault(job.identity, job)
        if other is not job:
            raise ConfigError(
                f"jobs {other.num} ({other.label}) and {job.num} ({job.label}) learn the same: "
                "what they differ in does not change what is learned. Give each run once."
            )


class Mistakes:
    """The mistakes in the jobs of a sweep; one that several share is reported once."""

    def __init__(self, labels: Sequence[str]) -> None:
        self.labels = labels
        self.jobs: dict[str, list[int]] = {}

    def add(self, num: int, error: Exception | None) -> None:
        """Note it for job ``num``; None is no mistake."""
        if error is not None:
            self.jobs.setdefault(str(error).strip(), []).append(num)

    def raise_any(self) -> None:
        """
        Raises:
            ConfigError: where there are any.
        """
        if self.jobs:
            raise ConfigError("\n".join(self._line(*item) for item in self.jobs.items()))

    def _line(self, message: str, nums: Sequence[int]) -> str:
        if len(nums) == len(self.labels):
            return message
        shown = ", ".join(f"{num} ({self.labels[num]})" for num in nums[:3])
        more = f" and {len(nums) - 3} more" if len(nums) > 3 else ""
        return f"{'job' if len(nums) == 1 else 'jobs'} {shown}{more}: {message}"


# --- presets ---------------------------------------------------------------------------------
def _description(hydra: DictConfig) -> str:
    """The comment at the head of a preset: the question that the sweep asks."""
    path = _preset_path(hydra)
    if path is None:
        return ""
    lines = path.read_text(encoding="utf-8").splitlines()
    comments = itertools.takewhile(lambda line: line.startswith("#"), lines)
    words = [line.lstrip("# ").rstrip() for line in comments if "@package" not in line]
    return " ".join(word for word in words if word)


def _preset_path(hydra: DictConfig) -> Path | None:
    preset = hydra.runtime.choices.get("sweep")
    for source in hydra.runtime.config_sources:
        if preset is None or source.schema not in ("pkg", "file"):
            continue
        folder = Path(str(files(source.path)) if source.schema == "pkg" else source.path)
        path = folder / "sweep" / f"{preset}.yaml"
        if path.is_file():
            return path
    return None
