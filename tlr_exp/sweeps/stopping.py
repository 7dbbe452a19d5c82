"""Ending a sweep: a file that its jobs look for, wherever they run, and the signals that make it.

A file, because jobs can be on other machines, where no signal reaches them.
"""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from types import FrameType

STOP = "stop"
END, KILL = "end", "kill"

POLL_S = 0.25


def request_stop(sweep: Path, how: str) -> None:
    """Ask all jobs of the sweep to END after their iteration, or to be KILLed at once."""
    (sweep / STOP).write_text(how)


def stop_requested(sweep: Path) -> str | None:
    """END, KILL, or None where nobody asked."""
    with suppress(OSError):
        return (sweep / STOP).read_text() or END
    return None


def clear_stop(sweep: Path) -> None:
    """Forget a request of an earlier attempt."""
    (sweep / STOP).unlink(missing_ok=True)


class Left(Exception):
    """The sweep was left while jobs wait in the queue of a cluster."""


class Stopper:
    """Turns the first SIGINT or SIGTERM into END, a second SIGINT into KILL, a third into Ctrl-C.

    A context: the handlers are those from before outside of it.

    Attributes:
        interrupts: how many SIGINT have come.
    """

    def __init__(self, sweep: Path) -> None:
        self.sweep = sweep
        self.interrupts = 0
        self._signalled = False
        self._leaving = False
        self._before: dict[int, Callable | int | None] = {}

    def __enter__(self) -> Stopper:
        for number in (signal.SIGINT, signal.SIGTERM):
            self._before[number] = signal.getsignal(number)
            signal.signal(number, self._handle)
        return self

    def __exit__(self, *_: object) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)

    @property
    def stopping(self) -> bool:
        """True if a signal, or whoever made the file, has asked the sweep to end."""
        return self._signalled or stop_requested(self.sweep) is not None

    def leave(self) -> None:
        """From another thread: let `Left` be raised in the main one, wherever that waits."""
        self._leaving = True
        main = threading.main_thread().ident
        assert main is not None
        signal.pthread_kill(main, signal.SIGINT)

    def _handle(self, number: int, _: FrameType | None) -> None:
        if self._leaving:
            self._leaving = False
            raise Left
        if number == signal.SIGINT:
            self.interrupts += 1
        if self.interrupts > 2:
            raise KeyboardInterrupt
        self._signalled = True
        request_stop(self.sweep, KILL if self.interrupts == 2 else END)


class Watch(threading.Thread):
    """In the process of a job: ends it like Ctrl-C once the sweep asks, or nobody waits for it.

    Args:
        sweep: the sweep directory.
        sweep_is_alive: whether the process of the sweep still runs; always true for a job that is
            to outlive it.
    """

    def __init__(self, sweep: Path, sweep_is_alive: Callable[[], bool]) -> None:
        super().__init__(daemon=True, name="watch")
        self._sweep, self._sweep_is_alive = sweep, sweep_is_alive
        self._parent = os.getppid()
        self._done = threading.Event()

    def run(self) -> None:
        while not self._done.wait(POLL_S):
            orphaned = os.getppid() != self._parent or not self._sweep_is_alive()
            if orphaned or stop_requested(self._sweep):
                # Once: the training takes a second one as the order to drop everything.
                os.kill(os.getpid(), signal.SIGINT)
                return

    def finish(self) -> None:
        """No more signals from now on."""
        self._done.set()
        self.join()
