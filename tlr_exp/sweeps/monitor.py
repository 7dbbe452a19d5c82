"""Looks at a sweep while its main thread waits for a launcher, and shows what it sees."""

import threading
from collections.abc import Sequence
from pathlib import Path

from tlr_exp.records.directory import FAILED, FINISHED, INTERRUPTED, RUNNING
from tlr_exp.records.sweep_directory import CANCELLED, WAITING
from tlr_exp.sweeps.display import SweepDisplay
from tlr_exp.sweeps.progress import HELD, QUEUED_AGAIN, JobState
from tlr_exp.sweeps.session import Session
from tlr_exp.sweeps.spec import RUN_LOG, log_path

LOOK_S = 0.5


class Monitor(threading.Thread):
    """Shows states and events, and lets the sweep go where only a cluster's queue is waited for."""

    def __init__(self, session: Session, display: SweepDisplay) -> None:
        super().__init__(daemon=True, name="monitor")
        self._session, self._display = session, display
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
        self._display.close()

    def look(self) -> None:
        """Read, tell what is new, show the rest in one line."""
        states = self._session.states()
        for state in states:
            now = (state.status, state.reason)
            before = self._seen.get(state.num, (WAITING, "") if state.reason else now)
            if before != now and (news := self._news(state, before[0])):
                self._display.say(f"job {state.num} ({state.label}) {news}")
            self._seen[state.num] = now
        self._display.show(states, self._note(states))
        self._leave_the_queue(states)

    def _news(self, state: JobState, before: str) -> str:
        """The message about a job that has changed; "" for none."""
        if state.status == RUNNING:
            return "" if before == RUNNING else f"runs, log {self._log(state)}"
        if state.status == FINISHED:
            return "has finished" if before == RUNNING else ""
        if state.status == FAILED:
            return f"FAILED: {state.error}\n    log {self._log(state)}"
        if state.status in (INTERRUPTED, CANCELLED):
            return f"was {state.status} at iteration {state.done} of {state.total}"
        if state.status in (QUEUED_AGAIN, HELD):
            why = f" ({state.reason})" if state.reason not in ("", "None") else ""
            return f"is {state.status}{why}"
        return f"waits, and will not start by itself: {state.reason}" if state.stuck else ""

    def _log(self, state: JobState) -> Path:
        return job_log(self._session.sweep.path, state)

    def _note(self, states: Sequence[JobState]) -> str:
        stopper = self._session.stopper
        if stopper.stopping and any(state.status == RUNNING for state in states):
            # The first only asks for what a stop file has asked for already.
            how = "again" if stopper.interrupts else "twice"
            return f"stopping after this iteration; Ctrl-C {how} kills"
        elsewhere = self._session.elsewhere
        return f"{len(elsewhere)} trained by others" if elsewhere else ""

    def _leave_the_queue(self, states: Sequence[JobState]) -> None:
        """Jobs in the queue of a cluster look for the stop when they start: nobody need wait."""
        stopper = self._session.stopper
        if self._session.launcher.leaves_by_itself or not stopper.stopping:
            return
        if self._left or self._done.is_set() or any(s.status == RUNNING for s in states):
            return
        self._left = True
        stopper.leave()


def job_log(sweep: Path, state: JobState) -> Path:
    """The log of what a job printed: in its run directory, or beside its record."""
    log = None if state.run is None else state.run / RUN_LOG
    return from_here(log if log is not None and log.exists() else log_path(sweep, state.num))


def from_here(path: Path) -> Path:
    """The path relative to the working folder, where that holds it."""
    here = Path.cwd()
    return path.relative_to(here) if path.is_relative_to(here) else path
