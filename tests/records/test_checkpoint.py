"""Checkpoints: whole or absent, the right ones kept, damage noticed and stepped over."""

import logging
import random
import signal
import subprocess
import sys
import textwrap
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from tlr_exp.records.checkpoint import CheckpointError, CheckpointStore, load_checkpoint
from tlr_exp.records.storage import StorageError


def state(value: float = 1.0) -> dict[str, Any]:
    generator = torch.Generator().manual_seed(7)
    torch.rand(3, generator=generator)
    return {
        "policy": {"weight": torch.full((4, 3), value), "count": torch.tensor(3)},
        "generator": generator.get_state(),
        "betas": (0.9, 0.999),
        "history": [1, 2.5, "text", None, True, {"deep": torch.arange(3)}],
        "pcg64": 2**127 + 1,
        "iteration": 12,
    }


def assert_same(first: Any, second: Any) -> None:
    assert type(first) is type(second)
    if isinstance(first, torch.Tensor):
        assert first.dtype == second.dtype
        assert torch.equal(first, second)
    elif isinstance(first, dict):
        assert first.keys() == second.keys()
        for key in first:
            assert_same(first[key], second[key])
    elif isinstance(first, (list, tuple)):
        assert len(first) == len(second)
        for one, other in zip(first, second, strict=True):
            assert_same(one, other)
    else:
        assert first == second


def test_state_comes_back_as_it_was(tmp_path: Path) -> None:
    store = CheckpointStore(tmp_path / "checkpoints", keep_last=2)
    path = store.save(12, state())
    assert path == store.path_of(12)
    loaded = load_checkpoint(path)
    assert_same(loaded, state())
    generator = torch.Generator()
    generator.set_state(loaded["generator"])
    expected = torch.Generator().manual_seed(7)
    torch.rand(3, generator=expected)
    assert torch.equal(torch.rand(5, generator=generator), torch.rand(5, generator=expected))


def test_map_location(tmp_path: Path) -> None:
    path = CheckpointStore(tmp_path, keep_last=1).save(1, state())
    assert load_checkpoint(path, "meta")["policy"]["weight"].device.type == "meta"


def test_what_is_kept(tmp_path: Path) -> None:
    store = CheckpointStore(tmp_path, keep_last=2, keep_iterations=frozenset({20}))
    scores = {10: 1.0, 20: 0.5, 30: 3.0, 40: None, 50: 2.0, 60: float("nan"), 70: 3.0}
    for iteration, score in scores.items():
        store.save(iteration, {"i": iteration}, score)
    # 60 and 70 are the last two, 20 was asked for, 30 has the highest score first.
    assert store.iterations() == [20, 30, 60, 70]
    assert store.best() == store.path_of(30)


@settings(deadline=None, max_examples=40)
@given(
    scores=st.lists(st.none() | st.floats(-10, 10), min_size=1, max_size=12),
    keep_last=st.integers(1, 4),
    named=st.frozensets(st.integers(0, 12), max_size=3),
)
def test_kept_set_is_last_k_and_best_and_named(
    tmp_path_factory: pytest.TempPathFactory,
    scores: list[float | None],
    keep_last: int,
    named: frozenset[int],
) -> None:
    store = CheckpointStore(tmp_path_factory.mktemp("kept"), keep_last, named)
    for iteration, score in enumerate(scores):
        store.save(iteration, {"i": iteration}, score)
    scored = [(score, -i) for i, score in enumerate(scores) if score is not None]
    best = {-max(scored)[1]} if scored else set()
    every = set(range(len(scores)))
    last = set(sorted(every)[-keep_last:])
    assert set(store.iterations()) == (last | best | named) & every
    assert store.best() == (store.path_of(best.pop()) if best else None)


def test_scores_survive_a_new_store(tmp_path: Path) -> None:
    CheckpointStore(tmp_path, 1).save(1, {}, score=5.0)
    again = CheckpointStore(tmp_path, 1)
    again.save(2, {}, score=4.0)
    assert again.best() == again.path_of(1)
    again.save(1, {}, score=3.0)  # trained again after a resume: the new score counts
    assert again.best() == again.path_of(2)


def test_empty_store(tmp_path: Path) -> None:
    store = CheckpointStore(tmp_path / "none", keep_last=3)
    assert (store.best(), store.iterations()) == (None, [])
    assert store.latest_valid() is None


def test_keep_last_must_be_positive(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="keep_last is 0"):
        CheckpointStore(tmp_path, keep_last=0)


@pytest.mark.parametrize(
    ("bad", "where"),
    [
        ({"a": {"b": [0, np.float64(1)]}}, r"state\['a'\]\['b'\]\[1\] is a float64"),
        ({"rng": np.zeros(3)}, r"state\['rng'\] is a ndarray"),
        ({"f": len}, r"state\['f'\] is a builtin_function"),
        ({(1, 2): 0}, r"state has the key \(1, 2\)"),
    ],
)
def test_state_that_could_not_be_loaded_is_refused_at_saving(
    tmp_path: Path, bad: dict, where: str
) -> None:
    with pytest.raises(CheckpointError, match=where):
        CheckpointStore(tmp_path, 1).save(1, bad)
    assert list(tmp_path.iterdir()) == []


# --- damage ----------------------------------------------------------------------------------
def test_cut_off_newest_is_named_and_the_one_before_is_used(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    store = CheckpointStore(tmp_path, keep_last=3)
    store.save(10, state(1.0))
    newest = store.save(20, state(2.0))
    newest.write_bytes(newest.read_bytes()[:-200])
    with caplog.at_level(logging.WARNING):
        found = store.latest_valid()
    assert found is not None
    assert (found.iteration, found.path) == (10, store.path_of(10))
    assert_same(found.state, state(1.0))
    assert "000020.pt" in caplog.text


def test_every_length_of_a_cut_file_is_noticed(tmp_path: Path) -> None:
    path = CheckpointStore(tmp_path, 1).save(1, {"t": torch.rand(200)})
    data = path.read_bytes()
    for length in range(0, len(data), 131):
        path.write_bytes(data[:length])
        with pytest.raises(CheckpointError, match=r"cannot read checkpoint .*000001\.pt"):
            load_checkpoint(path)


def test_a_flipped_bit_in_a_tensor_is_noticed(tmp_path: Path) -> None:
    values = torch.arange(1000, dtype=torch.int64)
    path = CheckpointStore(tmp_path, 1).save(1, {"t": values})
    data = bytearray(path.read_bytes())
    position = bytes(data).index(values.numpy().tobytes()) + random.Random(0).randrange(8000)
    data[position] ^= 1
    path.write_bytes(data)
    with pytest.raises(CheckpointError, match="damaged"):
        load_checkpoint(path)


def test_errors_for_what_is_no_checkpoint(tmp_path: Path) -> None:
    with pytest.raises(CheckpointError, match=r"there is no checkpoint .*none\.pt"):
        load_checkpoint(tmp_path / "none.pt")
    with pytest.raises(CheckpointError, match="cannot read checkpoint"):
        load_checkpoint(tmp_path)
    torch.save([1, 2], tmp_path / "list.pt")
    with pytest.raises(CheckpointError, match="holds a list"):
        load_checkpoint(tmp_path / "list.pt")
    torch.save({"path": tmp_path}, tmp_path / "code.pt")
    with pytest.raises(CheckpointError, match="cannot read checkpoint"):
        load_checkpoint(tmp_path / "code.pt")


def test_all_damaged_is_an_error_and_not_a_fresh_start(tmp_path: Path) -> None:
    store = CheckpointStore(tmp_path, keep_last=2)
    store.save(1, {}).write_bytes(b"")
    with pytest.raises(CheckpointError, match="none of the checkpoints"):
        store.latest_valid()


@pytest.mark.parametrize("damaged", ["{", "[1.0]", '{"one": 1.0}', '{"1": null}'])
def test_damaged_scores_cost_only_the_best(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, damaged: str
) -> None:
    store = CheckpointStore(tmp_path, keep_last=2)
    store.save(1, {}, score=1.0)
    (tmp_path / "scores.json").write_text(damaged)
    assert store.best() is None
    store.save(2, {}, score=0.0)
    assert store.best() == store.path_of(2)
    assert "scores.json" in caplog.text


def test_full_disk_keeps_earlier_checkpoints_and_leaves_no_rest(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    store = CheckpointStore(tmp_path, keep_last=1)
    store.save(10, state(), score=1.0)
    monkeypatch.setattr(store, "_clear_rests", lambda: None)  # it would remove the next line's trap
    (tmp_path / ".000020.pt.tmp").symlink_to("/dev/full")
    with pytest.raises(StorageError, match=r"000020\.pt: No space left.*intact.*resume"):
        store.save(20, state(), score=2.0)
    assert store.iterations() == [10]
    assert_same(load_checkpoint(store.path_of(10)), state())
    assert store.best() == store.path_of(10)  # the score of 20 has no file
    assert sorted(path.name for path in tmp_path.iterdir()) == ["000010.pt", "scores.json"]


def test_rest_of_a_killed_save_is_cleared_by_the_next(tmp_path: Path) -> None:
    store = CheckpointStore(tmp_path, keep_last=2)
    (tmp_path / ".000005.pt.tmp").write_bytes(b"half")
    assert store.iterations() == []
    store.save(6, {})
    assert [path.name for path in tmp_path.iterdir()] == ["000006.pt"]


def test_folder_that_cannot_be_made(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(StorageError, match=r"cannot make .*file/checkpoints"):
        CheckpointStore(tmp_path / "file" / "checkpoints", 1).save(1, {})


def test_killed_at_any_moment_the_newest_file_is_whole(tmp_path: Path) -> None:
    code = """
        import sys, torch
        from tlr_exp.records.checkpoint import CheckpointStore
        store = CheckpointStore(sys.argv[1], keep_last=2)
        start = store.iterations()[-1] + 1 if store.iterations() else 0
        for iteration in range(start, 10**6):
            state = {"t": torch.full((300_000,), float(iteration))}
            store.save(iteration, state, score=float(iteration))
            print(iteration, flush=True)
    """
    pauses = random.Random(1)
    store = CheckpointStore(tmp_path, keep_last=2)
    for _ in range(3):
        process = subprocess.Popen(
            [sys.executable, "-c", textwrap.dedent(code), str(tmp_path)],
            stdout=subprocess.PIPE,
            text=True,
        )
        assert process.stdout is not None
        process.stdout.readline()
        time.sleep(pauses.uniform(0.0, 0.1))
        process.send_signal(signal.SIGKILL)
        said = process.communicate()[0].split()
        iteration = store.iterations()[-1]
        newest = load_checkpoint(store.path_of(iteration))
        assert torch.equal(newest["t"], torch.full((300_000,), float(iteration)))
        assert iteration >= max((int(word) for word in said), default=0)
