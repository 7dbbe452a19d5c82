"""Files that are whole or not there: atomic writes, appended lines, errors that say what to do."""

import errno
import json
import os
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from functools import wraps
from pathlib import Path
from typing import Any, TypeVar

from tlr_exp.errors import UserError

_TAIL_BYTES = 1 << 16  # step in which the end of a file is searched for its last line break

INTACT = "What was written before is intact"

Content = TypeVar("Content")


class StorageError(UserError, OSError):
    """A file of a run could not be written; the message names it and says how to go on."""

    def __init__(self, action: str, cause: OSError, hint: str) -> None:
        reason = os.strerror(cause.errno) if cause.errno else str(cause)
        super().__init__(f"{action}: {reason}. {hint}")
        self.errno = cause.errno


@contextmanager
def storage_errors(action: str, hint: str) -> Iterator[None]:
    """Turn any OSError of the body into a StorageError (one that already is passes unchanged)."""
    try:
        yield
    except StorageError:
        raise
    except OSError as error:
        raise StorageError(action, error, hint) from error


def _write_hint(path: Path) -> str:
    return f"{INTACT}: make room in (or allow writing to) {path.parent}, then resume the run."


def temporary_name(path: Path) -> Path:
    """The file in which `atomic_write` builds `path`; if it exists, a write was killed."""
    return path.with_name(f".{path.name}.tmp")


def atomic_write(path: Path, data: bytes | memoryview) -> None:
    """Replace `path` by `data`, durably: whoever looks sees the old file or the new one, whole.

    Write to a temporary file beside it, fsync, rename, fsync the folder. One writer at a time.

    Raises:
        StorageError: the disk is full, read-only, ...; the old file stays, no temporary is left.
    """
    temporary = temporary_name(path)
    with storage_errors(f"cannot write {path}", _write_hint(path)):
        try:
            write_through(temporary, data)
            os.replace(temporary, path)
        except BaseException:
            with suppress(OSError):
                temporary.unlink(missing_ok=True)
            raise
        sync_folder(path.parent)


def write_through(path: Path, data: bytes | memoryview) -> None:
    """Write a file and force it onto the disk.

    Raises:
        OSError: the disk is full, read-only, ...; a part of the file may be there.
    """
    with open(path, "wb") as file:
        file.write(data)
        file.flush()
        os.fsync(file.fileno())


def file_state(path: Path) -> tuple[int, int, int]:
    """Inode, size and time of a file: another one once it has been written.

    Raises:
        OSError: there is no such file.
    """
    status = path.stat()
    return status.st_ino, status.st_size, status.st_mtime_ns


def while_unchanged(read: Callable[[Path], Content]) -> Callable[[Path], Content]:
    """`read`, which reads a file again only once that has changed.

    What it gives is the same object until then, so nobody may change it.
    """
    known: dict[Path, tuple[tuple[int, int, int], Content]] = {}

    @wraps(read)
    def read_if_changed(path: Path) -> Content:
        try:
            state = file_state(path)
        except OSError:
            return read(path)
        before = known.get(path)
        if before is None or before[0] != state:
            # The state is that before the reading: what is written meanwhile is read again.
            before = known[path] = (state, read(path))
        return before[1]

    return read_if_changed


def json_bytes(record: Mapping[str, Any], allow_nan: bool = True) -> bytes:
    """A record as indented JSON in UTF-8.

    A path may hold bytes that are no text; they are written as JSON's own escapes.
    """
    text = json.dumps(record, indent=2, ensure_ascii=False, allow_nan=allow_nan)
    return f"{text}\n".encode("utf-8", "backslashreplace")


def sync_folder(folder: Path) -> None:
    """Make renames and new names in `folder` survive a power cut, where the system can."""
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    except OSError as error:
        # Some network file systems cannot fsync a folder; the rename has still happened.
        if error.errno not in (errno.EINVAL, errno.ENOTSUP, errno.EBADF):
            raise
    finally:
        os.close(descriptor)


def sync_file(path: Path) -> None:
    """Force what was appended to `path` onto the disk.

    Raises:
        StorageError: the disk refuses it.
    """
    with storage_errors(f"cannot write {path}", _write_hint(path)):
        descriptor = os.open(path, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)


def append_line(path: Path, line: bytes) -> None:
    """Append `line` (without its line break) in one write call, so that a kill tears at most it.

    A torn last line that an earlier kill left is cut off first; a line that does not fit on the
    disk is taken back whole.

    Raises:
        StorageError: the line could not be written; the file holds what it held before.
    """
    with storage_errors(f"cannot write {path}", _write_hint(path)):
        descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_APPEND, 0o644)
        try:
            size = os.fstat(descriptor).st_size
            whole = _end_of_last_line(descriptor, size)
            if whole < size:
                os.ftruncate(descriptor, whole)
            _write_or_take_back(descriptor, line + b"\n", whole)
        finally:
            os.close(descriptor)


def _write_or_take_back(descriptor: int, data: bytes, start: int) -> None:
    try:
        if os.write(descriptor, data) < len(data):
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
    except BaseException:
        with suppress(OSError):
            os.ftruncate(descriptor, start)
        raise


def _end_of_last_line(descriptor: int, size: int) -> int:
    """Length of the file up to and with its last line break (0 where there is none)."""
    end = size
    while end > 0:
        start = max(0, end - _TAIL_BYTES)
        position = os.pread(descriptor, end - start, start).rfind(b"\n")
        if position >= 0:
            return start + position + 1
        end = start
    return 0
