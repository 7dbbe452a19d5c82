"""The metrics of a run: a line an iteration, whole whatever befalls the process or the disk."""

import json
import math
import os
import time

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from run_on_disk import full_disk_at, kill, start_python

from tlr_exp.records.metrics_file import DamagedMetricsError, read_metrics
from tlr_exp.records.run_directory import RunDirectory
from tlr_exp.records.storage import StorageError

names = st.text(min_size=1).filter(lambda name: name not in ("iteration", "wall_time"))
values = st.floats() | st.integers(-(2**53), 2**53)


@settings(deadline=None, max_examples=60)
@given(lines=st.lists(st.dictionaries(names, values, max_size=5), max_size=6))
def test_metrics_round_trip(tmp_path_factory: pytest.TempPathFactory, lines: list[dict]) -> None:
    run = RunDirectory(tmp_path_factory.mktemp("run"))
    for iteration, metrics in enumerate(lines):
        run.log(iteration, metrics)
    back = run.metrics()
    assert [row.pop("iteration") for row in back] == list(range(len(lines)))
    assert all(abs(row.pop("wall_time") - time.time()) < 60 for row in back)
    for row, metrics in zip(back, lines, strict=True):
        assert row.keys() == metrics.keys()
        for name, value in metrics.items():
            if math.isfinite(value):
                assert row[name] == value
            else:
                assert math.isnan(row[name])


def test_lines_are_portable_json_and_one_an_iteration(run: RunDirectory) -> None:
    run.log(0, {"a": math.nan, "b": -math.inf, "c": True})
    run.log(1, {"a": 1.5})
    lines = (run.path / "metrics.jsonl").read_text().splitlines()
    first = json.loads(lines[0], parse_constant=pytest.fail)
    assert len(lines) == 2
    assert (first["a"], first["b"], first["c"]) == (None, None, 1)


def test_log_names_the_metric_it_refuses(run: RunDirectory) -> None:
    with pytest.raises(ValueError, match="'loss' is str, not one number"):
        run.log(0, {"loss": "high"})  # pyright: ignore[reportArgumentType]
    with pytest.raises(ValueError, match="'iteration' is reserved"):
        run.log(0, {"iteration": 1})
    assert run.metrics() == []


def test_log_takes_numpy_and_tensor_scalars(run: RunDirectory) -> None:
    import numpy as np
    import torch

    run.log(0, {"n": np.float32(0.5), "i": np.int64(7), "t": torch.tensor([2.0])})  # type: ignore[dict-item]
    row = run.metrics()[0]
    assert (row["n"], row["i"], row["t"]) == (0.5, 7.0, 2.0)
    with pytest.raises(ValueError, match="'t' is Tensor, not one number"):
        run.log(1, {"t": torch.zeros(2)})  # type: ignore[dict-item]


def test_torn_last_line_is_passed_over_and_cut_off_by_the_next(run: RunDirectory) -> None:
    run.log(0, {"a": 1.0})
    run.log(1, {"a": 2.0})
    whole = run.metrics_path.read_bytes()
    run.metrics_path.write_bytes(whole[:-10])
    assert [row["iteration"] for row in run.metrics()] == [0]
    run.log(1, {"a": 3.0})
    assert [(row["iteration"], row["a"]) for row in run.metrics()] == [(0, 1.0), (1, 3.0)]


def test_zeros_that_a_power_cut_leaves_count_as_torn(run: RunDirectory) -> None:
    run.log(0, {"a": 1.0})
    with open(run.metrics_path, "ab") as file:
        file.write(b"\0" * 5000)
    assert [row["iteration"] for row in run.metrics()] == [0]
    run.log(1, {"a": 1.0})
    assert [row["iteration"] for row in run.metrics()] == [0, 1]


def test_damage_in_the_middle_is_named(run: RunDirectory) -> None:
    for iteration in range(3):
        run.log(iteration, {"a": 1.0})
    lines = run.metrics_path.read_bytes().splitlines(keepends=True)
    run.metrics_path.write_bytes(lines[0] + b"{broken\n" + lines[2])
    with pytest.raises(
        DamagedMetricsError, match=rf"metrics\.jsonl: the line at byte {len(lines[0])} .*broken"
    ):
        run.metrics()


def test_iteration_logged_twice_counts_once(run: RunDirectory) -> None:
    for iteration, value in [(0, 1.0), (2, 2.0), (1, 3.0), (2, 4.0)]:
        run.log(iteration, {"a": value})
    assert [(r["iteration"], r["a"]) for r in run.metrics()] == [(0, 1.0), (1, 3.0), (2, 4.0)]


@pytest.mark.parametrize(("last", "left"), [(-1, []), (2, [0, 1, 2]), (9, [0, 1, 2, 3, 4])])
def test_truncate_after(run: RunDirectory, last: int, left: list[int]) -> None:
    run.truncate_after(last)  # nothing logged yet: nothing to do
    for iteration in range(5):
        run.log(iteration, {"a": math.nan, "b": 0.1})
    before = run.metrics()
    run.truncate_after(last)
    after = run.metrics()
    assert [row["iteration"] for row in after] == left
    assert [row["wall_time"] for row in after] == [r["wall_time"] for r in before[: len(left)]]
    assert all(math.isnan(row["a"]) and row["b"] == 0.1 for row in after)
    run.log(last + 1, {"b": 0.2})
    assert run.metrics()[-1]["b"] in (0.1, 0.2)


def test_truncation_that_does_not_fit_changes_nothing(run: RunDirectory) -> None:
    for iteration in range(3):
        run.log(iteration, {"a": 1.0})
    full_disk_at(run.path / ".metrics.jsonl.tmp")
    with pytest.raises(StorageError, match="No space left"):
        run.truncate_after(0)
    assert len(run.metrics()) == 3


def test_full_disk_at_a_line_says_which_file_and_how_to_go_on(run: RunDirectory) -> None:
    full_disk_at(run.metrics_path)
    with pytest.raises(StorageError, match=r"metrics\.jsonl: No space left.*intact.*resume"):
        run.log(0, {"a": 1.0})


def test_line_that_fits_in_part_is_taken_back(
    run: RunDirectory, monkeypatch: pytest.MonkeyPatch
) -> None:
    run.log(0, {"a": 1.0})
    before = run.metrics_path.read_bytes()
    write = os.write
    monkeypatch.setattr(os, "write", lambda descriptor, data: write(descriptor, data[:7]))
    with pytest.raises(StorageError, match="No space left"):
        run.log(1, {"a": 1.0})
    assert run.metrics_path.read_bytes() == before


def test_reading_on_from_an_offset_leaves_the_unfinished_line(run: RunDirectory) -> None:
    assert read_metrics(run.metrics_path) == ([], 0)
    run.log(0, {"a": 1.0})
    rows, offset = read_metrics(run.metrics_path)
    assert (len(rows), offset) == (1, run.metrics_path.stat().st_size)
    with open(run.metrics_path, "ab") as file:
        file.write(b'{"iteration": 1, "wall_')
    assert read_metrics(run.metrics_path, offset) == ([], offset)
    with open(run.metrics_path, "ab") as file:
        file.write(b'time": 1.0}\n')
    rows, _ = read_metrics(run.metrics_path, offset)
    assert [row["iteration"] for row in rows] == [1]


def test_killed_writer_leaves_every_line_but_the_last_whole(run: RunDirectory) -> None:
    writer = """
        import sys
        from tlr_exp.records.run_directory import RunDirectory
        run = RunDirectory(__import__("pathlib").Path(sys.argv[1]))
        for iteration in range(10**9):
            run.log(iteration, {f"m{i}": i / 7 for i in range(300)})
            if iteration == 5:
                print("writing", flush=True)
    """
    process = start_python(writer, str(run.path))
    assert process.stdout is not None
    process.stdout.readline()
    time.sleep(0.05)
    kill(process)
    iterations = [row["iteration"] for row in run.metrics()]
    assert iterations == list(range(len(iterations)))
    assert len(iterations) >= 6


def test_flush(run: RunDirectory, monkeypatch: pytest.MonkeyPatch) -> None:
    run.flush()
    run.log(0, {"a": 1.0})
    synced = []
    monkeypatch.setattr(os, "fsync", lambda descriptor: synced.append(os.fstat(descriptor).st_ino))
    run.flush()
    assert synced == [run.metrics_path.stat().st_ino]
