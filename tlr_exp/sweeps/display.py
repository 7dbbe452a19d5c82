"""Shows a sweep to a person: events, one line of progress with ETA, and a table at the end."""

import sys
import time
from collections.abc import Sequence
from pathlib import Path

from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, Progress, TextColumn
from rich.table import Column, Table

from tlr_exp.records.directory import FAILED, FINISHED, INTERRUPTED, RUNNING
from tlr_exp.records.sweep_directory import CANCELLED, WAITING
from tlr_exp.sweeps.progress import HELD, QUEUED_AGAIN, JobState, Pace, counts
from tlr_exp.training.progress import clock

PLAIN_INTERVAL_S = 30.0
LOGS_WIDTH = 160  # columns of the table where no terminal sets them
STYLES = {
    **{FINISHED: "green", FAILED: "red", INTERRUPTED: "yellow", CANCELLED: "yellow"},
    **{RUNNING: "cyan", WAITING: "dim", QUEUED_AGAIN: "magenta", HELD: "magenta"},
}
TO_COME = (RUNNING, WAITING, QUEUED_AGAIN, HELD)


def progress_line(states: Sequence[JobState], pace: Pace, note: str = "") -> str:
    """Time left, jobs by status, iterations: the sweep in one line, what matters most first."""
    count = counts(states)
    parts = []
    if any(count[status] for status in TO_COME):
        eta = pace.eta_s(states)
        parts.append(f"ETA {'…' if eta is None else clock(eta)}")
    parts.append(f"{count[FINISHED]}/{len(states)} jobs done")
    shown = (RUNNING, FAILED, CANCELLED, INTERRUPTED, QUEUED_AGAIN, HELD, WAITING)
    parts += [f"{count[s]} {s}{_reasons(states, s)}" for s in shown if count[s]]
    done, total = sum(state.done for state in states), sum(state.total for state in states)
    parts.append(f"iteration {done}/{total}")
    return "  ".join([*parts, note] if note else parts)


def _reasons(states: Sequence[JobState], status: str) -> str:
    """The queue's words for why jobs of this status wait, in brackets."""
    reasons = dict.fromkeys(s.reason for s in states if s.status == status and s.reason)
    return f" ({', '.join(reasons)})" if reasons else ""


class PlainSweepDisplay:
    """The line whenever a job changed its state, otherwise every ``interval_s`` seconds."""

    def __init__(self, name: str, pace: Pace, interval_s: float = PLAIN_INTERVAL_S) -> None:
        self.name, self.pace, self.interval_s = name, pace, interval_s
        self._shown_at = -float("inf")
        self._shown: object = None

    def say(self, line: str) -> None:
        """A line that stays."""
        print(line, flush=True)

    def show(self, states: Sequence[JobState], note: str) -> None:
        """The states now, and what is to be known besides."""
        now = time.monotonic()
        self.pace.note(states, now)
        seen = (counts(states), {state.reason for state in states}, note)
        if seen == self._shown and now - self._shown_at < self.interval_s:
            return
        self._shown_at, self._shown = now, seen
        print(f"{self.name}: {progress_line(states, self.pace, note)}", flush=True)

    def close(self) -> None:
        pass


class LiveSweepDisplay:
    """A bar and the line, redrawn in place; lines that stay scroll away above it."""

    def __init__(self, name: str, pace: Pace, console: Console) -> None:
        self.pace = pace
        self.bar = Progress(
            TextColumn(escape(name)),
            BarColumn(bar_width=10),
            TextColumn(
                "{task.fields[line]}", table_column=Column(no_wrap=True, overflow="ellipsis")
            ),
            console=console,
        )
        self.task = self.bar.add_task("", total=1, line="")
        self.bar.start()

    def say(self, line: str) -> None:
        self.bar.console.print(escape(line), highlight=False, soft_wrap=True)

    def show(self, states: Sequence[JobState], note: str) -> None:
        self.pace.note(states, time.monotonic())
        self.bar.update(
            self.task,
            completed=sum(state.done for state in states),
            total=sum(state.total for state in states),
            line=escape(progress_line(states, self.pace, note)),
        )

    def close(self) -> None:
        self.bar.stop()


SweepDisplay = PlainSweepDisplay | LiveSweepDisplay


def make_sweep_display(name: str, slots: int | None) -> SweepDisplay:
    """A live line on a terminal, plain lines elsewhere; of a sweep with ``slots`` jobs at once."""
    pace = Pace(slots)
    if sys.stdout.isatty():
        return LiveSweepDisplay(name, pace, Console())
    return PlainSweepDisplay(name, pace)


def print_table(states: Sequence[JobState], logs: Sequence[Path | None]) -> None:
    """Each job with its end; below, why jobs failed and where that is written."""
    console = Console() if sys.stdout.isatty() else Console(width=LOGS_WIDTH)
    table = Table(box=None, pad_edge=False)
    for title in ("job", "what differs", "status", "run directory"):
        table.add_column(title, overflow="fold")
    for state in states:
        style = STYLES.get(state.status, "")
        status = f"[{style}]{state.status}[/]" if style else state.status
        unfinished = state.run is not None and state.status != FINISHED
        reached = f" at {state.done} of {state.total}" if unfinished else ""
        run = "" if state.run is None else state.run.name
        status += escape(f": {state.reason}" if state.reason else "")
        table.add_row(str(state.num), escape(state.label), status + reached, escape(run))
    console.print(table)
    for state, log in zip(states, logs, strict=True):
        if state.status == FAILED or (state.error and state.status in (INTERRUPTED, CANCELLED)):
            line = f"job {state.num} {'failed' if state.status == FAILED else state.status}"
            console.print(f"{line}: {state.error}", markup=False, highlight=False, soft_wrap=True)
        if state.status == FAILED:
            console.print(f"    log {log}", markup=False, highlight=False, soft_wrap=True)
