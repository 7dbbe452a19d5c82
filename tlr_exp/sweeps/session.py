"""One attempt at a sweep: looks what is there, hands out the rest, and takes stock."""

import time
from collections.abc import Callable, Sequence

from tlr_exp.records.directory import FAILED, FINISHED, INTERRUPTED, RUNNING, SWEEP
from tlr_exp.records.run_directory import RunDirectory
from tlr_exp.records.runs import latest_runs
from tlr_exp.records.sweep_directory import CANCELLED, WAITING, SweepDirectory
from tlr_exp.sweeps.launching import Launcher
from tlr_exp.sweeps.parallel import LauncherError, RefusedError
from tlr_exp.sweeps.progress import JobState, job_states
from tlr_exp.sweeps.spec import JobSpec, Plan, write_spec
from tlr_exp.sweeps.stopping import Left, Stopper

ENDED = (FINISHED, FAILED, INTERRUPTED, CANCELLED)
LOOK_AGAIN_S = 2.0  # how often it is looked whether a run that others train has ended
MAX_STARTS = 3  # of a job that comes back as it went, before it counts as failed
SETTLE_S = 120.0  # how long a job whose launcher broke down may take for its last iteration


class Session:
    """Works off a plan in its sweep directory, which the caller holds locked.

    Attributes:
        launcher: runs jobs and returns when they have ended.
        elsewhere: the numbers of the jobs that other processes train.
        launcher_error: what the launcher broke down with, if it did.

    Args:
        say: shows a line to the person.
    """

    def __init__(
        self,
        plan: Plan,
        sweep: SweepDirectory,
        launcher: Launcher,
        stopper: Stopper,
        say: Callable[[str], None],
    ) -> None:
        self.plan, self.sweep = plan, sweep
        self.launcher, self.stopper, self._say = launcher, stopper, say
        self._starts = dict.fromkeys((job.num for job in plan.jobs), 0)
        self._told: set[int] = set()
        self.elsewhere: set[int] = set()
        self.launcher_error: str | None = None

    def prepare(self) -> None:
        """Write what each job needs, and mark those that wait; before anything is started."""
        for job in self.plan.jobs:
            write_spec(self.sweep.path, job)
            if not self.sweep.job_path(job.num).exists():
                self.sweep.write_job(job.num, WAITING, overrides=job.overrides)

    def states(self) -> list[JobState]:
        """Of all jobs, as they stand on disk and in the queue now."""
        return job_states(self.sweep, self.plan.jobs, self.launcher.remarks)

    def is_finished(self) -> bool:
        """True if an earlier attempt finished the sweep and all of its runs still exist."""
        if not (self.sweep.path / SWEEP).is_file() or self.sweep.manifest["status"] != FINISHED:
            return False
        runs = latest_runs(self.plan.study_folder, prefer_finished=True) if self.plan.go_on else {}
        found = [runs.get(job.identity) for job in self.plan.jobs]
        return all(run is not None and run.status == FINISHED for run in found)

    def work_off(self) -> None:
        """Until every job has ended or somebody stops the sweep.

        Raises:
            RefusedError: the jobs cannot be run as they are.
        """
        waiting = list(self.plan.jobs)
        try:
            while waiting and not self.stopper.stopping:
                ready = self._take_stock(waiting)
                if ready:
                    self.launcher.launch(ready, self.stopper, self._say)
                elif self.elsewhere:
                    time.sleep(LOOK_AGAIN_S)
                waiting = [job for job in waiting if not self._has_ended(job)]
        except RefusedError:
            raise
        except LauncherError as error:
            self.launcher_error = str(error)
        except Left:
            return
        self._settle()

    def _take_stock(self, waiting: Sequence[JobSpec]) -> list[JobSpec]:
        """Of the waiting jobs those to be started; the finished and those of others are noted."""
        runs: dict[str, RunDirectory] = {}
        if self.plan.go_on:
            runs = latest_runs(self.plan.study_folder, prefer_finished=True)
        held = self.launcher.held()
        ready: list[JobSpec] = []
        self.elsewhere = set()
        for job in waiting:
            run = runs.get(job.identity)
            if run is not None and run.status == FINISHED:
                self._write(job, FINISHED, run)
                self._tell(job, f"job {job.num} ({job.label}) is trained already: {run.path.name}")
            elif job.num in held:
                ready.append(job)  # its record is what it wrote itself
            elif run is not None and run.is_live():
                self.elsewhere.add(job.num)
                self._tell(job, f"job {job.num} ({job.label}) is trained by another process: wait")
            else:
                self._write(job, WAITING, run)
                ready.append(job)
        return ready

    def _has_ended(self, job: JobSpec) -> bool:
        """True if the job needs no more starts; one that never says anything has failed."""
        if job.num in self.elsewhere:
            return False
        if self.sweep.job(job.num).status in ENDED:
            return True
        self._starts[job.num] += 1
        if self._starts[job.num] < MAX_STARTS:
            return False
        self.sweep.write_job(job.num, FAILED, error=f"started {MAX_STARTS} times without an answer")
        return True

    def _settle(self) -> None:
        """Jobs that still run although the launcher has ended were left by it: see them end.

        Each notices by itself that nobody waits for it, and ends after its iteration.
        """
        deadline = time.monotonic() + SETTLE_S
        for job in self.plan.jobs:
            record = self.sweep.job(job.num)
            if record.status != RUNNING or record.run is None:
                continue
            run = RunDirectory(self.sweep.study_folder / record.run)
            while run.is_live() and time.monotonic() < deadline:
                time.sleep(0.2)
            if not run.is_live() and self.sweep.job(job.num).status == RUNNING:
                self.sweep.write_job(job.num, FAILED, error="it and its launcher were killed")

    def _write(self, job: JobSpec, status: str, run: RunDirectory | None) -> None:
        name = run_id = None
        if run is not None:
            name, run_id = run.path.name, run.manifest["run_id"]
        self.sweep.write_job(job.num, status, overrides=job.overrides, run=name, run_id=run_id)

    def _tell(self, job: JobSpec, line: str) -> None:
        if job.num not in self._told:
            self._told.add(job.num)
            self._say(line)
