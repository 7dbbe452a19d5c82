"""Submitting jobs: the options of sbatch, and the script that each element runs."""

import shlex
import sys
from collections.abc import Sequence
from pathlib import Path

from tlr_exp.records.storage import atomic_write
from tlr_exp.sweeps.slurm.elements import index_list
from tlr_exp.sweeps.slurm.settings import Needs, SlurmSettings
from tlr_exp.sweeps.spec import LAUNCHER_FOLDER

# In the sweep directory: what SLURM, the script and the process that watches over the job print.
LOG = "%A_%a.log"
SCRIPT = "from-{}.sh"


def write_script(sweep: Path, base: int, settings: SlurmSettings) -> Path:
    """The batch script of the array whose index 0 stands for job ``base``.

    It becomes the process that watches over the job, without srun between: SLURM's signals reach
    that process whatever the cluster tracks processes by, and it has all that the job reserved.

    Raises:
        StorageError: it cannot be written.
    """
    command = [sys.executable, "-m", "tlr_exp.sweeps.slurm.node", str(sweep)]
    limits = ["--timeouts", str(settings.max_num_timeout), "--delay", str(settings.signal_delay_s)]
    words = shlex.join([*command, *limits, "--limit", str(settings.timeout_min)])
    lines = ["#!/bin/bash", *(settings.setup or []), f"exec {words} --base {base}"]
    path = sweep / LAUNCHER_FOLDER / SCRIPT.format(base)
    path.parent.mkdir(exist_ok=True)
    atomic_write(path, ("\n".join(lines) + "\n").encode())
    return path


def was_submitted(sweep: Path) -> bool:
    """True if anything of the sweep was ever handed to sbatch, whatever came of it."""
    return any((sweep / LAUNCHER_FOLDER).glob(SCRIPT.format("*")))


def options(
    sweep: Path, comment: str, settings: SlurmSettings, needs: Needs, indices: Sequence[int]
) -> list[str]:
    """For sbatch: what the settings say, and what makes elements that can be queued again."""
    at_once = f"%{settings.array_parallelism}" if settings.array_parallelism else ""
    # A percent sign in a folder's name would be one of sbatch's own.
    folder = str(sweep / LAUNCHER_FOLDER).replace("%", "%%")
    given = {
        "array": f"{index_list(indices)}{at_once}",
        "job-name": settings.name,
        "comment": comment,
        "output": f"{folder}/{LOG}",
        "open-mode": "append",
        "chdir": str(Path.cwd()),
        "requeue": True,
        "time": settings.timeout_min,
        "signal": f"B:USR2@{settings.signal_delay_s}",
        "nodes": 1,
        "ntasks": 1,
        "cpus-per-task": needs.cpus,
        "mem": f"{needs.mem_mb}M",
        "gpus-per-node": settings.gpus_per_node,
        "partition": settings.partition,
        "account": settings.account,
        "qos": settings.qos,
        "constraint": settings.constraint,
        **{
            key.replace("_", "-"): value
            for key, value in (settings.additional_parameters or {}).items()
        },
    }
    said = {key: value for key, value in given.items() if value is not None and value is not False}
    return [f"--{key}" if value is True else f"--{key}={value}" for key, value in said.items()]
