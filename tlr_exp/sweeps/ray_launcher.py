"""Jobs on a Ray cluster, or on a Ray that is started here and ends with the sweep.

Ray is used by itself: each job is waited for alone, a job whose node was lost is given to another,
and the signals of this process stay its own.
"""

import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any, TextIO

from tlr_exp.records.directory import RUNNING
from tlr_exp.records.sweep_directory import WAITING, SweepDirectory
from tlr_exp.sweeps.launching import Launcher
from tlr_exp.sweeps.parallel import LauncherError
from tlr_exp.sweeps.progress import QUEUED_AGAIN, Remark
from tlr_exp.sweeps.spec import LAUNCHER_FOLDER, JobSpec
from tlr_exp.sweeps.stopping import Stopper
from tlr_exp.sweeps.task import CLUSTER_PATIENCE_S, JOB_VARIABLE, JobTask, conclude

LOG = "ray.log"  # in the folder of the launcher: what Ray would print into the display
LOOK_S = 0.5
MAX_LOSSES = 3  # of one job's nodes or workers, before it counts as failed
LOST = "its node was lost"

INSTALL = (
    "hydra/launcher=ray_cluster: Ray is not installed. In the folder of this project: "
    "python -m pip install --constraint constraints.txt --editable '.[ray]'"
)


class RayLauncher(Launcher):
    """One attempt at a sweep on Ray; its jobs end with it, so that none is ever `held`.

    Args:
        launcher: the configuration node hydra.launcher.
        sweep: the sweep directory.

    Raises:
        LauncherError: Ray is not installed.
    """

    def __init__(self, launcher: Mapping[str, Any], sweep: Path) -> None:
        super().__init__()
        if find_spec("ray") is None:
            raise LauncherError(INSTALL)
        settings = launcher.get("ray") or {}
        self._init = dict(settings.get("init") or {})
        self._remote = {**(settings.get("remote") or {}), "max_retries": 0}
        self._sweep = SweepDirectory(sweep)
        self._task = JobTask(str(sweep), os.getpid(), CLUSTER_PATIENCE_S)
        self._losses: dict[int, int] = {}

    def launch(self, jobs: Sequence[JobSpec], stopper: Stopper, say: Callable[[str], None]) -> None:
        """Run jobs, and wait until all have ended; see `Launcher`."""
        ray = import_module("ray")  # slow, and not there by default
        with _quiet(self._sweep.path / LAUNCHER_FOLDER / LOG):
            try:
                with _own_signals():
                    ray.init(**self._init, ignore_reinit_error=True)
                self._work_off(ray, jobs, stopper, say)
            except (ConnectionError, RuntimeError, ValueError, TypeError) as error:
                address = self._init.get("address") or "a Ray of its own"
                raise LauncherError(f"Ray ({address}): {_first_line(error)}") from error
            finally:
                with _as_ray():
                    ray.shutdown()

    def _work_off(
        self, ray: Any, jobs: Sequence[JobSpec], stopper: Stopper, say: Callable[[str], None]
    ) -> None:
        start = ray.remote(**self._remote)(run_task).remote
        going = {start(self._task, job.num): job for job in jobs}
        cancelled = False
        while going:
            for ref in ray.wait(list(going), num_returns=1, timeout=LOOK_S)[0]:
                job = going.pop(ref)
                if self._was_lost(ray, ref, job, stopper, say):
                    going[start(self._task, job.num)] = job
            self._note_stuck(ray, [job.num for job in going.values()])
            if stopper.stopping and not cancelled:
                cancelled = True
                for ref, job in going.items():
                    if self._sweep.job(job.num).status != RUNNING:
                        ray.cancel(ref)  # what no node can take would never find out

    def _was_lost(
        self, ray: Any, ref: Any, job: JobSpec, stopper: Stopper, say: Callable[[str], None]
    ) -> bool:
        """True if a job that Ray has done with is to be started again, on another node."""
        try:
            ray.get(ref)
        except ray.exceptions.TaskCancelledError:
            return False
        except ray.exceptions.RayError as error:
            losses = self._losses[job.num] = self._losses.get(job.num, 0) + 1
            if stopper.stopping:
                return False
            if losses > MAX_LOSSES:
                words = f"lost {losses} times by Ray: {_first_line(error)}"
                conclude(self._sweep, job.num, "failed", words)
                return False
            why = _first_line(error)
            say(f"job {job.num} ({job.label}): {LOST}, another continues it ({why})")
            self._sweep.write_job(job.num, WAITING)
            self._note(job.num, Remark(QUEUED_AGAIN, LOST))
        else:
            self._note(job.num, None)
            return False
        return True

    def _note_stuck(self, ray: Any, nums: Sequence[int]) -> None:
        """Mark the waiting jobs if there is no node that is large enough for one."""
        wanted = {"CPU": self._remote.get("num_cpus", 1), "GPU": self._remote.get("num_gpus", 0)}
        nodes = [node["Resources"] for node in ray.nodes() if node["Alive"]]
        fits = any(all(node.get(k, 0) >= v for k, v in wanted.items() if v) for node in nodes)
        asked = ", ".join(f"{value:g} {kind}" for kind, value in wanted.items() if value)
        for num in nums:
            before = self.remarks.get(num)
            if not fits:
                self._note(num, Remark(WAITING, f"no node has {asked}", stuck=True))
            elif before is not None and before.stuck:
                self._note(num, None)


def run_task(task: JobTask, num: int) -> None:
    """In a worker of Ray: the job, in a process of its own."""
    os.environ[JOB_VARIABLE] = str(num)
    task(None)


@contextmanager
def _own_signals() -> Iterator[None]:
    """Have the handlers of before again: Ray puts its own for SIGTERM in their place."""
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


@contextmanager
def _quiet(path: Path) -> Iterator[None]:
    """Let what Ray says meanwhile go to a file: all of stderr, and what its threads print."""
    path.parent.mkdir(exist_ok=True)
    sys.stderr.flush()
    before, kept = sys.stdout, os.dup(2)
    with open(path, "a", buffering=1, encoding="utf-8") as log:
        os.dup2(log.fileno(), 2)
        sys.stdout = _WithoutRay(before, log)  # type: ignore[assignment]
        try:
            yield
        finally:
            sys.stdout = before
            sys.stderr.flush()
            os.dup2(kept, 2)
            os.close(kept)


class _WithoutRay:
    """A stream like ``stdout``; what threads of Ray write into it goes to ``log``."""

    def __init__(self, stdout: TextIO, log: TextIO) -> None:
        self._stdout, self._log = stdout, log

    def write(self, text: str) -> int:
        is_ray = threading.current_thread().name.startswith("ray_")
        return (self._log if is_ray else self._stdout).write(text)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stdout, name)


@contextmanager
def _as_ray() -> Iterator[None]:
    """What this thread prints meanwhile is Ray's: the lines that it has held back."""
    thread = threading.current_thread()
    before, thread.name = thread.name, "ray_shutdown"
    try:
        yield
    finally:
        thread.name = before


def _first_line(error: BaseException) -> str:
    return str(error).strip().partition("\n")[0][:200] or type(error).__name__
