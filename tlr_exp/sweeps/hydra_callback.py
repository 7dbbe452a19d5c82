"""Where a sweep leaves Hydra: after it has composed the command, before it would start the jobs.

Hydra's sweeper would start finished jobs, too, tell of a failure by an exception after the last
job, and know nothing of resuming. Its launchers are used; `SweepCallback` is in conf/config.yaml.
"""

from __future__ import annotations

import sys
import traceback
from collections.abc import Callable, Collection, Mapping, Sequence
from pathlib import Path
from typing import Any

from hydra._internal.callbacks import Callbacks
from hydra.core.global_hydra import GlobalHydra
from hydra.core.plugins import Plugins
from hydra.experimental.callback import Callback
from hydra.types import HydraContext
from omegaconf import DictConfig, open_dict

from tlr_exp.sweeps.parallel import LauncherError, Parallelism
from tlr_exp.sweeps.progress import Remark
from tlr_exp.sweeps.spec import LAUNCHER_FOLDER, PlannedJob
from tlr_exp.sweeps.stopping import Left, Stopper
from tlr_exp.sweeps.task import JOB_VARIABLE


class SweepCallback(Callback):
    """Runs the sweep in place of Hydra and leaves with its exit status."""

    def on_multirun_start(self, config: DictConfig, **kwargs: Any) -> None:
        # Not before: single runs are to start fast.
        from tlr_exp.sweeps.command import run_sweep

        try:
            status = run_sweep(config)
        except Exception:
            # Hydra would make a warning of it and start the jobs by itself.
            traceback.print_exc()
            status = 1
        sys.exit(status)


class HydraLauncher:
    """Hands jobs to the launcher that the configuration names.

    Args:
        config: Hydra's configuration of the whole sweep.
        task: what the launcher calls for each job, wherever it does.
        how: what the launcher does with the jobs.

    Raises:
        LauncherError: the launcher is not installed or refuses its settings.
    """

    def __init__(self, config: DictConfig, sweep: Path, task: Any, how: Parallelism) -> None:
        self._config = config
        folder = str(sweep / LAUNCHER_FOLDER)
        with open_dict(config):
            config.hydra.sweep.dir = folder
            config.hydra.sweep.subdir = "."
            # For the jobs, each of which is composed again from these.
            config.hydra.overrides.hydra += [f"hydra.sweep.dir={quoted(folder)}"]
            config.hydra.overrides.hydra += ["hydra.sweep.subdir=."]
            if "n_jobs" in config.hydra.launcher and how.slots is not None:
                config.hydra.launcher.n_jobs = how.slots
        # Made once before anything starts, so that a mistake shows; `launch` makes its own.
        self._task = task
        self._make()

    leaves_by_itself = False
    remarks: Mapping[int, Remark] = {}

    def held(self) -> Collection[int]:
        """None: Hydra's launchers know nothing of earlier attempts."""
        return ()

    def left_in_the_queue(self) -> str:
        """Nothing that this process could know of."""
        return ""

    def launch(
        self, jobs: Sequence[PlannedJob], stopper: Stopper, say: Callable[[str], None]
    ) -> None:
        """Run jobs, and wait until all have ended; see `Launcher`."""
        overrides = [
            [*job.overrides, f"+hydra.job.env_set.{JOB_VARIABLE}='{job.num}'"] for job in jobs
        ]
        try:
            self._make().launch(overrides, initial_job_idx=0)
        except Left:
            raise
        except Exception as error:
            raise LauncherError(
                f"the launcher broke down: {type(error).__name__}: {error}"
            ) from error

    def _make(self) -> Any:
        context = HydraContext(
            config_loader=GlobalHydra.instance().config_loader(), callbacks=Callbacks()
        )
        try:
            return Plugins.instance().instantiate_launcher(
                hydra_context=context, task_function=self._task, config=self._config
            )
        except Exception as error:
            target = str(self._config.hydra.launcher.get("_target_"))
            raise LauncherError(f"hydra/launcher: {target} cannot be used: {error}") from error


def quoted(text: str) -> str:
    """``text`` as a value in an override, whatever characters it holds."""
    escaped = text.replace("\\", "\\\\").replace("'", "\\'")
    return f"'{escaped}'"
