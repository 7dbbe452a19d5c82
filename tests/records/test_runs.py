"""Identity, names and look-up of runs."""

import threading
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tlr_exp.records.directory import ARTIFACTS
from tlr_exp.records.run_directory import RunDirectory
from tlr_exp.records.runs import config_hash, find_run, next_run_path
from tlr_exp.records.storage import StorageError

plain = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False) | st.text(),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(), inner, max_size=3),
    max_leaves=8,
)


@given(config=st.dictionaries(st.text(), plain, max_size=4))
def test_hash_does_not_depend_on_the_order_of_keys(config: dict) -> None:
    backwards = dict(reversed(config.items()))
    assert config_hash(config) == config_hash(backwards)
    assert len(config_hash(config)) == 8
    assert int(config_hash(config), 16) >= 0


def test_hash_ignores_only_what_it_is_told_to() -> None:
    config = {"seed": 0, "run": {"name": "a", "scale": "demo"}, "tracking": {"uri": "x"}}
    other = {"seed": 0, "run": {"name": "b", "scale": "demo"}, "tracking": {"uri": "y", "z": 1}}
    ignore = ("tracking", "run.name", "run.missing", "no.such.key", "seed.deeper")
    assert config_hash(config, ignore) == config_hash(other, ignore)
    assert config_hash(config) != config_hash(other)
    other["run"]["scale"] = "paper"
    assert config_hash(config, ignore) != config_hash(other, ignore)
    assert config["tracking"] == {"uri": "x"}  # the configuration itself is untouched


def test_hash_is_that_of_the_canonical_json() -> None:
    # printf '{"a":{"b":[1,2.5,null]},"c":"x"}' | sha256sum
    assert config_hash({"c": "x", "a": {"b": [1, 2.5, None]}}) == "778c15af"


def test_names_count_up(tmp_path: Path) -> None:
    made = [next_run_path(tmp_path / "runs", "gwo").name for _ in range(3)]
    assert made == ["gwo", "gwo-2", "gwo-3"]


def test_names_stay_apart_when_asked_for_at_once(tmp_path: Path) -> None:
    made: list[Path] = []
    barrier = threading.Barrier(8)

    def ask() -> None:
        barrier.wait()
        made.extend(next_run_path(tmp_path, "gwo") for _ in range(20))

    threads = [threading.Thread(target=ask) for _ in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(set(made)) == 160


@pytest.mark.parametrize("name", ["", ".", "..", "a/b", "/abs"])
def test_names_must_be_one_folder(tmp_path: Path, name: str) -> None:
    with pytest.raises(ValueError, match="one folder name"):
        next_run_path(tmp_path, name)


def test_root_that_cannot_be_made(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(StorageError, match=r"cannot make a run directory in .*file/runs"):
        next_run_path(tmp_path / "file" / "runs", "gwo")


def test_find_runs_looks_below_but_not_into_runs_or_mlflow_files(tmp_path: Path) -> None:
    first = RunDirectory.create(tmp_path / "sweep" / "a", {}, {})
    second = RunDirectory.create(tmp_path / "b", {}, {})
    for copy in (first.path / "backup", tmp_path / ARTIFACTS / "1" / "artifacts"):
        copy.mkdir(parents=True)
        (copy / "manifest.json").write_bytes((first.path / "manifest.json").read_bytes())
    assert [run.path for run in RunDirectory.find(tmp_path)] == [second.path, first.path]
    assert [run.path for run in RunDirectory.find(first.path)] == [first.path]
    assert RunDirectory.find(tmp_path / "nowhere") == []


def test_find_run_takes_the_latest_of_its_identity_whatever_the_status(tmp_path: Path) -> None:
    assert find_run(tmp_path, "aa") is None
    RunDirectory.create(tmp_path / "z-old", {}, {}, "aa")
    newest = RunDirectory.create(tmp_path / "a-new", {}, {}, "aa")
    RunDirectory.create(tmp_path / "other", {}, {}, "bb")
    newest.set_status("finished")
    found = find_run(tmp_path, "aa")
    assert found is not None
    assert (found.path, found.status) == (newest.path, "finished")


def test_find_run_passes_over_a_damaged_manifest(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    good = RunDirectory.create(tmp_path / "good", {}, {}, "aa")
    bad = RunDirectory.create(tmp_path / "bad", {}, {}, "aa")
    (bad.path / "manifest.json").write_text("{")
    found = find_run(tmp_path, "aa")
    assert found is not None
    assert found.path == good.path
    assert "bad" in caplog.text
