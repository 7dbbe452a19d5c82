"""One process at a time: lock files whose lock the system frees when its holder dies (flock)."""

import fcntl
import os
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

from tlr_exp.records.storage import StorageError, storage_errors

ELSEWHERE = "Give a folder that can be written and has room."
_POLL_S = 0.02


@contextmanager
def hold(path: Path, in_use: Callable[[], Exception], timeout_s: float = 1.0) -> Iterator[None]:
    """Hold the lock file `path`; what `in_use` makes is raised where another process keeps it.

    Raises:
        Exception: that of `in_use`, still locked after `timeout_s` seconds.
        StorageError: the lock file cannot be made.
    """
    deadline = time.monotonic() + timeout_s
    with storage_errors(f"cannot lock {path.parent}", ELSEWHERE):
        while (descriptor := _locked(path)) is None:
            if time.monotonic() >= deadline:
                raise in_use()
            time.sleep(_POLL_S)
    try:
        yield
    finally:
        os.close(descriptor)  # which frees the lock


@contextmanager
def hold_where_possible(
    path: Path, in_use: Callable[[], Exception], timeout_s: float
) -> Iterator[None]:
    """As `hold`, but without the lock on read-only media: nobody writes there.

    Raises:
        Exception: that of `in_use`, still locked after `timeout_s` seconds.
    """
    with ExitStack() as stack:
        with suppress(StorageError):
            stack.enter_context(hold(path, in_use, timeout_s))
        yield


def is_held(path: Path) -> bool:
    """True if a process holds the lock file `path` now; it is tried for an instant."""
    if not path.exists():
        return False
    try:
        descriptor = _locked(path)
    except OSError:  # read-only media: nobody writes there
        return False
    if descriptor is not None:
        os.close(descriptor)
    return descriptor is None


def _locked(path: Path) -> int | None:
    """A descriptor that holds the lock of the file until it is closed; None where it is held."""
    descriptor = os.open(path, os.O_RDWR | os.O_CREAT, 0o644)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BaseException as error:
        os.close(descriptor)
        if isinstance(error, BlockingIOError):
            return None
        raise
    return descriptor
