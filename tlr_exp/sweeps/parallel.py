"""Decides how many jobs a launcher runs at once, on how many threads; whether they outlive it."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from tlr_exp.errors import UserError

# PyTorch, NumPy and MuJoCo's helpers read these when they are loaded.
THREAD_VARIABLES = (
    *("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS"),
    "NUMEXPR_NUM_THREADS",
)

# Of tlr_exp.sweeps, not Hydra's.
SLURM_LAUNCHER, RAY_LAUNCHER = "SlurmLauncher", "RayLauncher"


class LauncherError(UserError):
    """The launcher is not installed, refuses its settings, or broke down."""


class RefusedError(LauncherError):
    """The jobs are refused as they are: the same command would be refused again."""


@dataclass(frozen=True)
class Parallelism:
    """The way in which a launcher runs the jobs.

    Attributes:
        slots: jobs at once at most; None where a cluster decides.
        threads: of each job; 0 = all cores that the job is given.
        detached: the jobs go on when the process of the sweep ends, and may be on other machines.
    """

    slots: int | None
    threads: int
    detached: bool


def parallelism(launcher: Mapping[str, Any], num_jobs: int, cores: int) -> Parallelism:
    """The way the launcher of this configuration node runs ``num_jobs`` on ``cores``.

    Threads are shared out so that jobs on the same machine do not fight for its cores. A launcher
    that is not one of the presets' counts as a cluster.
    """
    name = str(launcher.get("_target_", "")).rpartition(".")[2]
    if name == "BasicLauncher":
        return Parallelism(1, cores, detached=False)
    if name == "JoblibLauncher":
        slots = _joblib_slots(launcher.get("n_jobs", -1), num_jobs, cores)
        return Parallelism(slots, max(1, cores // slots), detached=False)
    if name == SLURM_LAUNCHER:
        return Parallelism(None, int(launcher.get("cpus_per_task") or 0), detached=True)
    if name == RAY_LAUNCHER:
        given = (launcher.get("ray") or {}).get("remote", {}).get("num_cpus")
        return Parallelism(None, max(1, int(given or 1)), detached=False)
    return Parallelism(None, 0, detached=True)


def _joblib_slots(n_jobs: int, num_jobs: int, cores: int) -> int:
    """joblib's own reading: -1 is all cores, -2 all but one, and so on."""
    wanted = cores + 1 + n_jobs if n_jobs < 0 else n_jobs
    return max(1, min(wanted, num_jobs))
