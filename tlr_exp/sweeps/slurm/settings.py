"""Checks what a sweep asks of SLURM for each of its jobs: conf/hydra/launcher/slurm.yaml."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any

from tlr_exp.config.checks import is_number
from tlr_exp.sweeps.parallel import LauncherError

# SLURM looks at time limits now and then, so a warning can come so much sooner than asked for.
EARLIEST_S = 60
# Before its end an element is queued again, whether its job has ended or not.
RESERVE_S = 20
LEAST_DELAY_S = RESERVE_S + 1
# A training of the scale demo takes 1 GB; most of it is PyTorch, MuJoCo and a batch.
BASE_MEM_GB, ENVS_PER_GB = 3, 512
JAX_MEM_GB = 8  # on the host, to compile and to hold the model
ENVS_PER_CORE, MOST_CORES = 64, 8
WITH_GPU_CORES = 4  # for the Python beside the accelerator

_PREFIX = "hydra.launcher"


@dataclass(frozen=True)
class SlurmSettings:
    """The keys of the preset; None leaves a value to the cluster, or to `needs`.

    Raises:
        LauncherError: a key that there is not, or a value that cannot be; names it.
    """

    name: str
    partition: str | None
    account: str | None
    qos: str | None
    constraint: str | None
    timeout_min: int
    max_num_timeout: int
    signal_delay_s: int
    cpus_per_task: int | None
    gpus_per_node: int | str | None
    mem_gb: float | None
    array_parallelism: int | None
    setup: Sequence[str] | None
    additional_parameters: Mapping[str, Any]

    @classmethod
    def read(cls, launcher: Mapping[str, Any]) -> SlurmSettings:
        """From the configuration node ``hydra.launcher``."""
        given = {key: value for key, value in launcher.items() if key != "_target_"}
        known = [field.name for field in fields(cls)]
        if unknown := sorted(set(given) - set(known)):
            raise LauncherError(
                f"{_PREFIX}.{unknown[0]}: there is no such key; there are {', '.join(known)}. Any "
                f"other option of sbatch goes into {_PREFIX}.additional_parameters"
            )
        settings = cls(**given)
        settings.check()
        return settings

    def check(self) -> None:
        """
        Raises:
            LauncherError: see there.
        """
        for name, least in (
            ("timeout_min", 1),
            ("max_num_timeout", 0),
            ("signal_delay_s", LEAST_DELAY_S),
        ):
            _require_whole(name, getattr(self, name), least)
        for name in ("cpus_per_task", "array_parallelism"):
            if getattr(self, name) is not None:
                _require_whole(name, getattr(self, name), 1)
        if self.mem_gb is not None and not (is_number(self.mem_gb) and self.mem_gb > 0):
            raise LauncherError(f"{_PREFIX}.mem_gb={self.mem_gb}: must be more than 0, or null")
        if isinstance(self.setup, str):
            raise LauncherError(
                f"{_PREFIX}.setup={self.setup!r}: must be a list of lines, such as ['{self.setup}']"
            )
        self._leave_time_to_train()

    def _leave_time_to_train(self) -> None:
        limit_s = 60 * self.timeout_min
        left_s = limit_s - self.signal_delay_s
        if left_s < EARLIEST_S:
            needed = -(-(self.signal_delay_s + EARLIEST_S) // 60)
            raise LauncherError(
                f"{_PREFIX}.timeout_min={self.timeout_min}, {_PREFIX}.signal_delay_s="
                f"{self.signal_delay_s}: a job has {limit_s} s and is warned {self.signal_delay_s}"
                f" s before their end, by SLURM's clock up to {EARLIEST_S} s sooner: no time is "
                f"left to train in. Give timeout_min={needed} or more, or a shorter signal_delay_s"
            )


@dataclass(frozen=True)
class Needs:
    """The processors that each job reserves, and its memory in MB."""

    cpus: int
    mem_mb: int


def needs(
    settings: SlurmSettings, configs: Sequence[Mapping[str, Any]], node: Needs | None
) -> Needs:
    """The resources that the largest of the jobs takes, or those of the settings.

    Args:
        configs: the resolved configuration of each job.
        node: what the largest node has, which bounds what is not said; None: not known.
    """
    cpus = max(_cpus(config) for config in configs)
    mem_mb = max(_mem_mb(config) for config in configs)
    if node is not None:
        cpus, mem_mb = min(cpus, node.cpus), min(mem_mb, node.mem_mb)
    if settings.mem_gb is not None:
        mem_mb = max(1, round(1024 * settings.mem_gb))
    return Needs(settings.cpus_per_task or cpus, mem_mb)


def _cpus(config: Mapping[str, Any]) -> int:
    """The threads that the job asks for; where it leaves them open, what its scale can use."""
    asked = max(config["num_threads"], config["physics"].get("num_threads") or 0)
    if asked:
        return asked
    if config["device"] != "cpu":
        return WITH_GPU_CORES
    return max(1, min(MOST_CORES, config["scale"]["num_envs"] // ENVS_PER_CORE))


def _mem_mb(config: Mapping[str, Any]) -> int:
    envs_gb = -(-config["scale"]["num_envs"] // ENVS_PER_GB)
    jax_gb = JAX_MEM_GB if "mjx" in str(config["physics"].get("_target_")) else 0
    return 1024 * (BASE_MEM_GB + envs_gb + jax_gb)


def _require_whole(name: str, value: Any, least: int) -> None:
    if not isinstance(value, int) or isinstance(value, bool) or value < least:
        raise LauncherError(f"{_PREFIX}.{name}={value}: must be a whole number, {least} or more")
