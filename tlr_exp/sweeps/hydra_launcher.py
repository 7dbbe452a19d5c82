"""Jobs by one of Hydra's launchers: one after the other, by joblib, or by one of a person's own."""

import os
from collections.abc import Callable, Sequence
from typing import Any

from hydra.core.override_parser.types import Quote, QuotedString
from hydra.core.plugins import Plugins
from hydra.types import HydraContext
from omegaconf import DictConfig, open_dict

from tlr_exp.sweeps.launching import Launcher
from tlr_exp.sweeps.parallel import LauncherError
from tlr_exp.sweeps.spec import LAUNCHER_FOLDER, JobSpec, Plan
from tlr_exp.sweeps.stopping import Left, Stopper
from tlr_exp.sweeps.task import JOB_VARIABLE, JobTask


class HydraLauncher(Launcher):
    """Hands jobs to the launcher that the configuration names; it knows of no earlier attempts.

    Args:
        config: Hydra's configuration of the whole sweep.
        context: what Hydra gives its sweeper for its launchers.

    Raises:
        LauncherError: the launcher is not installed or refuses its settings.
    """

    def __init__(self, config: DictConfig, context: HydraContext, plan: Plan) -> None:
        super().__init__()
        self._config, self._context = config, context
        # What is not one of the presets' may wait for the queue of a cluster.
        self.leaves_by_itself = not plan.parallelism.detached
        folder = str(plan.path / LAUNCHER_FOLDER)
        quoted = QuotedString(folder, Quote.single).with_quotes()
        slots = plan.parallelism.slots
        with open_dict(config):
            config.hydra.sweep.dir = folder
            config.hydra.sweep.subdir = "."
            # For the jobs, each of which is composed again from these.
            config.hydra.overrides.hydra += [f"hydra.sweep.dir={quoted}"]
            config.hydra.overrides.hydra += ["hydra.sweep.subdir=."]
            if "n_jobs" in config.hydra.launcher and slots is not None:
                config.hydra.launcher.n_jobs = slots
        self._task = JobTask(str(plan.path), None if plan.parallelism.detached else os.getpid())
        # Made once before anything starts, so that a mistake shows; `launch` makes its own.
        self._make()

    def launch(self, jobs: Sequence[JobSpec], stopper: Stopper, say: Callable[[str], None]) -> None:
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
        try:
            return Plugins.instance().instantiate_launcher(
                hydra_context=self._context, task_function=self._task, config=self._config
            )
        except Exception as error:
            target = str(self._config.hydra.launcher.get("_target_"))
            raise LauncherError(f"hydra/launcher: {target} cannot be used: {error}") from error
