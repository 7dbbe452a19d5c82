"""What a sweep is to do: its jobs, and what each is given as a file beside its record."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import yaml

from tlr_exp.records.storage import atomic_write
from tlr_exp.records.sweep_directory import JOBS
from tlr_exp.sweeps.parallel import Parallelism

LAUNCHER_FOLDER = "launcher"  # in the sweep directory: what launchers leave behind
RUN_LOG = "train.log"  # in the run directory: what the training of a job printed


@dataclass(frozen=True)
class JobSpec:
    """One job, whole.

    Attributes:
        config: the resolved configuration as plain data, with absolute paths.
        method: the chosen optimizer, for the name of the run.
        threads: of the job; 0 = all cores that it is given.
        go_on: whether it goes on with the run of this configuration that is there.
    """

    config: Mapping[str, Any]
    method: str
    threads: int
    go_on: bool


@dataclass(frozen=True)
class PlannedJob:
    """One job: its number, the overrides that make it, what tells it from the others."""

    num: int
    overrides: tuple[str, ...]
    label: str
    identity: str
    iterations: int
    spec: JobSpec


@dataclass(frozen=True)
class Plan:
    """A sweep before it starts.

    Attributes:
        sweep_id: 8 hex digits, the same wherever the same jobs are asked for in the same study.
        arms: the keys in which the jobs differ, without the seed.
        uri: the MLflow store, None for none.
    """

    name: str
    sweep_id: str
    study: str
    study_folder: Path
    description: str
    arms: tuple[str, ...]
    scale: str
    jobs: tuple[PlannedJob, ...]
    parallelism: Parallelism
    uri: str | None
    go_on: bool


def with_threads(spec: JobSpec, threads: int) -> JobSpec:
    """``spec`` on so many threads where it leaves the number open (0); with 0 as it is."""
    if threads == 0:
        return spec
    physics = dict(spec.config["physics"])
    if physics.get("num_threads") == 0:
        physics["num_threads"] = threads
    own = spec.config["num_threads"] or threads
    config = {**spec.config, "physics": physics, "num_threads": own}
    return replace(spec, config=config, threads=own)


def spec_path(sweep: Path, num: int) -> Path:
    """Where the specification of job ``num`` of the sweep directory lies."""
    return sweep / JOBS / f"{num}.yaml"


def log_path(sweep: Path, num: int) -> Path:
    """What job ``num`` printed before it had a run directory, and the launcher's words on it."""
    return sweep / JOBS / f"{num}.log"


def write_spec(sweep: Path, num: int, spec: JobSpec) -> None:
    """Keep the specification for the process of the job.

    Raises:
        StorageError: the file cannot be written.
    """
    content = {
        "method": spec.method,
        "threads": spec.threads,
        "go_on": spec.go_on,
        "config": dict(spec.config),
    }
    text = yaml.safe_dump(content, sort_keys=False, allow_unicode=True)
    atomic_write(spec_path(sweep, num), text.encode())


def read_spec(sweep: Path, num: int) -> JobSpec:
    """The specification of job ``num``.

    Raises:
        ValueError: it is missing or damaged; names the file.
    """
    path = spec_path(sweep, num)
    try:
        return JobSpec(**yaml.safe_load(path.read_text(encoding="utf-8")))
    except (OSError, TypeError, yaml.YAMLError) as error:
        raise ValueError(f"cannot read the specification of a job, {path}: {error}") from error
