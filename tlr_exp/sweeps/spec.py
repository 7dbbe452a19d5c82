"""The plan of a sweep: its jobs, each kept as a file beside its record, from which it starts."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import yaml

from tlr_exp.errors import UserError
from tlr_exp.records.storage import atomic_write
from tlr_exp.records.sweep_directory import JOBS, SWEEPS
from tlr_exp.sweeps.parallel import Parallelism

LAUNCHER_FOLDER = "launcher"  # in the sweep directory: what launchers leave behind
RUN_LOG = "train.log"  # in the run directory: what the training of a job printed

_KEPT = ("method", "config", "overrides", "label", "identity")


@dataclass(frozen=True)
class JobSpec:
    """The task of one job.

    Attributes:
        config: the resolved configuration as plain data, with absolute paths.
        method: the chosen optimizer, for the name of the run.
        overrides: those that make it what it is.
        label: what tells it from the other jobs.
        identity: of its run.
    """

    num: int
    config: Mapping[str, Any]
    method: str
    overrides: tuple[str, ...] = ()
    label: str = ""
    identity: str = ""

    @property
    def threads(self) -> int:
        """Of the job; 0 = all cores that it is given."""
        return self.config["num_threads"]

    @property
    def go_on(self) -> bool:
        """True if it continues an existing run of this configuration."""
        return self.config["resume"] != "never"

    @property
    def iterations(self) -> int:
        return self.config["scale"]["iterations"]


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
    jobs: tuple[JobSpec, ...]
    parallelism: Parallelism
    uri: str | None

    @property
    def path(self) -> Path:
        """Of the sweep directory."""
        return self.study_folder / SWEEPS / f"{self.name}-{self.sweep_id}"

    @property
    def go_on(self) -> bool:
        """True if existing runs are continued; the same for all jobs."""
        return self.jobs[0].go_on


def with_threads(spec: JobSpec, threads: int) -> JobSpec:
    """``spec`` on so many threads where it leaves the number open (0); with 0 as it is."""
    if threads == 0:
        return spec
    physics = dict(spec.config["physics"])
    if physics.get("num_threads") == 0:
        physics["num_threads"] = threads
    own = spec.config["num_threads"] or threads
    return replace(spec, config={**spec.config, "physics": physics, "num_threads": own})


def log_path(sweep: Path, num: int) -> Path:
    """The log of what job ``num`` printed before it had a run directory, and of its launcher."""
    return sweep / JOBS / f"{num}.log"


def write_spec(sweep: Path, spec: JobSpec) -> None:
    """Keep the specification for the process of the job.

    Raises:
        StorageError: the file cannot be written.
    """
    content = {name: getattr(spec, name) for name in _KEPT}
    content |= {"config": dict(spec.config), "overrides": list(spec.overrides)}
    text = yaml.safe_dump(content, sort_keys=False, allow_unicode=True)
    atomic_write(sweep / JOBS / f"{spec.num}.yaml", text.encode())


def read_spec(sweep: Path, num: int) -> JobSpec:
    """The specification of job ``num``; earlier versions kept no more than a job needs to start.

    Raises:
        UserError: it is missing or damaged; names the file.
    """
    path = sweep / JOBS / f"{num}.yaml"
    try:
        content = yaml.safe_load(path.read_text(encoding="utf-8"))
        kept = {name: content[name] for name in _KEPT if name in content}
        return JobSpec(num, **{**kept, "overrides": tuple(kept.get("overrides", ()))})
    except (OSError, TypeError, yaml.YAMLError) as error:
        raise UserError(f"cannot read the specification of a job, {path}: {error}") from error
