"""Looks at a sweep while its main thread waits for a launcher, and shows what it sees."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Collection, Sequence
from pathlib import Path

from tlr_exp.records.directory import FAILED, FINISHED, INTERRUPTED, RUNNING
from tlr_exp.records.sweep_directory import CANCELLED, WAITING, SweepDirectory
from tlr_exp.sweeps.display import SweepDisplay
from tlr_exp.sweeps.launching import Launcher
from tlr_exp.sweeps.progress import HELD, QUEUED_AGAIN, JobState, Pace, job_states
from tlr_exp.sweeps.spec import RUN_LOG, Plan, log_path
from tlr_exp.sweeps.stopping import Stopper

LOOK_S = 0.5


class Monitor(threading.Thread):
    """Shows states and events, and lets the sweep go where only a cluster's queue is waited for.

    Attributes:
        states: of all jobs at the last look.

    Args:
        elsewhere: gives the numbers of the jobs that other processes train.
        launcher: what the jobs were given to.
    """

    def __init__(
        self,
        plan: Plan,
        sweep: SweepDirectory,
        stopper: Stopper,
        display: SweepDisplay,
        pace: Pace,
        elsewhere: Callable[[], Collection[int]],
        launcher: Launcher,
    ) -> None:
        super().__init__(daemon=True, name="monitor")
        self.plan, self.sweep, self.stopper = plan, sweep, stopper
        self.display, self.pace, self._elsewhere = display, pace, elsewhere
        self._launcher = launcher
        self.states: list[JobState] = []
        self._seen: dict[int, tuple[str, str]] = {}
        self._done = threading.Event()
        self._left = False

    def run(self) -> None:
        while not self._done.wait(LOOK_S):
            self.look()

    def finish(self) -> None:
        """Stop looking, after a last look."""
        self._done.set()
        self.join()
        self.look()
        self.display.close()

    def look(self) -> None:
        """Read, tell what is new, show the rest in one line."""
        remarks = self._launcher.remarks
        found = job_states(self.sweep, self.plan.jobs)
        self.states = states = [state.with_remark(remarks.get(state.num)) for state in found]
        for state in states:
            now = (state.status, state.reason)
            before = self._seen.get(state.num, (WAITING, "") if state.reason else now)
            if before != now:
                self._announce(state, before[0])
            self._seen[state.num] = now
        self.pace.note(states, time.monotonic())
        self.display.show(states, self._note(states))
        self._leave_the_queue(states)

    def _announce(self, state: JobState, before: str) -> None:
        job = f"job {state.num} ({state.label})"
        log = job_log(self.sweep.path, state)
        if state.status == RUNNING and before != RUNNING:
            self.display.say(f"{job} runs, log {log}")
        elif state.status == FINISHED and before == RUNNING:
            self.display.say(f"{job} has finished")
        elif state.status == FAILED:
            self.display.say(f"{job} FAILED: {state.error}\n    log {log}")
        elif state.status == INTERRUPTED:
            self.display.say(f"{job} was interrupted at iteration {state.done} of {state.total}")
        elif state.status == CANCELLED:
            self.display.say(f"{job} was cancelled at iteration {state.done} of {state.total}")
        elif state.status in (QUEUED_AGAIN, HELD):
            why = f" ({state.reason})" if state.reason not in ("", "None") else ""
            self.display.say(f"{job} is {state.status}{why}")
        elif state.stuck:
            self.display.say(f"{job} waits, and will not start by itself: {state.reason}")

    def _note(self, states: Sequence[JobState]) -> str:
        if self.stopper.stopping and any(state.status == RUNNING for state in states):
            # The first only asks for what a stop file has asked for already.
            how = "again" if self.stopper.interrupts else "twice"
            return f"stopping after this iteration; Ctrl-C {how} kills"
        elsewhere = self._elsewhere()
        return f"{len(elsewhere)} trained by others" if elsewhere else ""

    def _leave_the_queue(self, states: Sequence[JobState]) -> None:
        """Jobs in the queue of a cluster look for the stop when they start: nobody need wait."""
        detached = self.plan.parallelism.detached and not self._launcher.leaves_by_itself
        if not (detached and self.stopper.stopping) or self._left or self._done.is_set():
            return
        if not any(state.status == RUNNING for state in states):
            self._left = True
            self.stopper.leave()


def job_log(sweep: Path, state: JobState) -> Path:
    """Where to read what a job printed: in its run directory, or beside its record."""
    log = None if state.run is None else state.run / RUN_LOG
    return from_here(log if log is not None and log.exists() else log_path(sweep, state.num))


def from_here(path: Path) -> Path:
    """The path relative to the working folder, where that holds it."""
    here = Path.cwd()
    return path.relative_to(here) if path.is_relative_to(here) else path
