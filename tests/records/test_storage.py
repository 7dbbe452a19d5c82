"""Files that are whole or not there, and lines that are."""

import os
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tlr_exp.records import storage
from tlr_exp.records.storage import append_line, atomic_write


def test_atomic_write_replaces_and_leaves_nothing_else(tmp_path: Path) -> None:
    path = tmp_path / "file"
    atomic_write(path, b"one")
    atomic_write(path, memoryview(b"two"))
    assert path.read_bytes() == b"two"
    assert list(tmp_path.iterdir()) == [path]


def test_atomic_write_is_on_disk_before_it_has_the_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    events = []
    fsync, replace = os.fsync, os.replace
    monkeypatch.setattr(os, "fsync", lambda d: (events.append("fsync"), fsync(d))[1])
    monkeypatch.setattr(os, "replace", lambda a, b: (events.append("rename"), replace(a, b))[1])
    atomic_write(tmp_path / "file", b"data")
    assert events == ["fsync", "rename", "fsync"]


@given(data=st.binary(max_size=300), line=st.binary(max_size=20).filter(lambda b: b"\n" not in b))
@settings(deadline=None, max_examples=50)
def test_appending_keeps_whole_lines_only(
    tmp_path_factory: pytest.TempPathFactory, data: bytes, line: bytes
) -> None:
    path = tmp_path_factory.mktemp("append") / "file"
    path.write_bytes(data)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(storage, "_TAIL_BYTES", 7)  # so that the search takes several steps
        append_line(path, line)
    assert path.read_bytes() == data[: data.rfind(b"\n") + 1] + line + b"\n"
