"""One process at a time: lock files whose lock the system frees when its holder dies (flock)."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from tlr_exp.records.storage import storage_errors

ELSEWHERE = "Give a folder that can be written and has room."


@contextmanager
def hold(path: Path, in_use: Callable[[], Exception], timeout_s: float = 1.0) -> Iterator[None]:
    """Hold the lock file `path`; what `in_use` makes is raised where another process keeps it.

    Raises:
        Exception: that of `in_use`, still locked after `timeout_s` seconds.
        StorageError: the lock file cannot be made.
    """
    import filelock

    file_lock = filelock.FileLock(path)
    with storage_errors(f"cannot lock {path.parent}", ELSEWHERE):
        try:
            file_lock.acquire(timeout=timeout_s, poll_interval=0.02)
        except filelock.Timeout:
            raise in_use() from None
    try:
        yield
    finally:
        file_lock.release()


def is_held(path: Path) -> bool:
    """Whether a process holds the lock file `path` now, by trying it for an instant."""
    import filelock

    if not path.exists():
        return False
    try:
        with filelock.FileLock(path).acquire(timeout=0):
            return False
    except filelock.Timeout:
        return True
    except OSError:  # read-only media: nobody writes there
        return False
