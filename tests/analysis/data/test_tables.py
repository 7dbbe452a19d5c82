"""Exported studies come back as they were, and damaged ones are refused in one clear line."""

import hashlib
import json
import os
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from studies import make_study

from analysis.data import tables
from analysis.data.study import CURVE_KEYS, Study, StudyError
from analysis.data.tables import CURVES, FILES, MANIFEST, RUNS, from_tables, write_tables


def study(iterations: int = 6) -> Study:
    return make_study(np.random.default_rng(0), seeds=range(2), iterations=iterations)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    write_tables(study(), tmp_path / "study", ["runs/study"], "tlr-export runs/study")
    return tmp_path / "study"


def same(one: Study, other: Study) -> None:
    pd.testing.assert_frame_equal(one.runs, other.runs)
    pd.testing.assert_frame_equal(one.curves, other.curves, check_exact=True)
    assert (one.arms, one.baseline, one.notes) == (other.arms, other.baseline, other.notes)


def error_of(folder: Path) -> str:
    """The message, which must be one line."""
    with pytest.raises(StudyError) as caught:
        from_tables(folder)
    (line,) = str(caught.value).splitlines()
    return line


# --- round trips -----------------------------------------------------------------------------
NUMBERS = st.floats(allow_nan=True, allow_infinity=False, width=64)
TEXTS = st.text(st.characters(exclude_categories=["Cs"]), max_size=20)


@settings(max_examples=40)
@given(data=st.data())
def test_any_study_comes_back_to_the_last_bit(
    data: st.DataObject, tmp_path_factory: pytest.TempPathFactory
) -> None:
    original = study(iterations=3)
    metrics = data.draw(st.lists(TEXTS.filter(bool), unique=True, min_size=1, max_size=4))
    metrics = [name for name in metrics if name not in CURVE_KEYS] or ["a"]
    length = len(original.curves)
    columns = {
        name: np.array(data.draw(st.lists(NUMBERS, min_size=length, max_size=length)))
        for name in metrics
    }
    curves = pd.concat([original.curves[list(CURVE_KEYS)], pd.DataFrame(columns)], axis=1)
    changed = {name: data.draw(TEXTS) for name in ("command", "host", "config", "motion")}
    seed = data.draw(st.integers(-(2**63), 2**63 - 3))
    runs = original.runs.assign(**changed, seed=original.runs["seed"] + seed)
    curves["seed"] += seed
    notes = tuple(data.draw(st.lists(TEXTS, max_size=2)))
    drawn = Study(runs, curves, baseline=data.draw(st.sampled_from(["", "gwo"])), notes=notes)
    folder = tmp_path_factory.mktemp("drawn") / "study"
    write_tables(drawn, folder)
    back = from_tables(folder)
    same(drawn, back)
    for name in metrics:  # -0.0 and every other pattern of bits, apart from the payload of NaN
        one, other = (each.curves[name].to_numpy() for each in (drawn, back))
        finite = ~np.isnan(one)
        np.testing.assert_array_equal(one[finite].view(np.int64), other[finite].view(np.int64))


def test_the_manifest_says_where_it_comes_from(folder: Path) -> None:
    manifest = json.loads((folder / MANIFEST).read_text())
    assert manifest["format"] == "tlr_exp study"
    assert (manifest["source"], manifest["command"]) == (["runs/study"], "tlr-export runs/study")
    assert (manifest["arms"], manifest["runs"], manifest["iterations"]) == (["fixed", "gwo"], 4, 6)
    assert manifest["sha256"] == {
        name: hashlib.sha256((folder / name).read_bytes()).hexdigest() for name in (RUNS, CURVES)
    }
    assert sorted(path.name for path in folder.parent.iterdir()) == ["study"]
    assert sorted(path.name for path in folder.iterdir()) == sorted(FILES)


def test_the_same_study_gives_the_same_bytes(folder: Path, tmp_path: Path) -> None:
    write_tables(study(), tmp_path / "again")
    for name in (RUNS, CURVES):
        assert (folder / name).read_bytes() == (tmp_path / "again" / name).read_bytes()


def test_five_seeds_of_laptop_scale_are_a_few_megabytes(tmp_path: Path) -> None:
    own = {f"reward_term/more{number}": lambda progress: progress for number in range(31)}
    # Noise in all 53 bits, which does not compress: a real study takes less.
    large = make_study(
        np.random.default_rng(0), {"fixed": own, "gwo": own}, range(5), iterations=407
    )
    assert len(large.metric_names) == 70
    write_tables(large, tmp_path / "large")
    assert sum(path.stat().st_size for path in (tmp_path / "large").iterdir()) < 2.5e6


def test_tables_made_elsewhere_may_be_plainer(folder: Path) -> None:
    """No metadata of pandas, no compression, smaller numbers, metrics of whole numbers."""
    original = from_tables(folder)
    curves = original.curves.assign(**{"train/unstable_envs": 0})
    curves = curves.astype({"seed": np.int32, "ppo/kl": np.float32})
    for name, frame in ((RUNS, original.runs.reset_index()), (CURVES, curves)):
        plain = pa.Table.from_pandas(frame, preserve_index=False).replace_schema_metadata(None)
        pq.write_table(plain, folder / name, compression="none")
    sign(folder)
    back = from_tables(folder)
    pd.testing.assert_frame_equal(original.runs, back.runs, check_column_type=False)
    assert back.curves["train/unstable_envs"].dtype == np.float64
    np.testing.assert_allclose(back.curves["ppo/kl"], original.curves["ppo/kl"], rtol=1e-7)


# --- what is refused -------------------------------------------------------------------------
def sign(folder: Path) -> None:
    """Make the sums of the manifest those of the files."""
    sums = {
        name: hashlib.sha256((folder / name).read_bytes()).hexdigest() for name in (RUNS, CURVES)
    }
    edit(folder, sha256=sums)


def edit(folder: Path, **changes: object) -> None:
    manifest = json.loads((folder / MANIFEST).read_text())
    (folder / MANIFEST).write_text(json.dumps({**manifest, **changes}))


def rewrite(folder: Path, name: str, change: Callable[[pd.DataFrame], pd.DataFrame]) -> None:
    """Change a table, and sign it as its writer would."""
    change(pd.read_parquet(folder / name)).to_parquet(folder / name, index=False)
    sign(folder)


@pytest.mark.parametrize("name", [RUNS, CURVES])
def test_a_changed_file_is_named(folder: Path, name: str) -> None:
    data = bytearray((folder / name).read_bytes())
    data[len(data) // 2] ^= 1
    (folder / name).write_bytes(bytes(data))
    message = f"{folder / name}: is damaged or was changed, its SHA-256 is not the one in"
    assert error_of(folder).startswith(message)


@pytest.mark.parametrize("name", [RUNS, CURVES])
@pytest.mark.parametrize("keep", [0, 1, 100, -1])
def test_a_truncated_table_is_named(folder: Path, name: str, keep: int) -> None:
    (folder / name).write_bytes((folder / name).read_bytes()[:keep])
    assert error_of(folder).startswith(f"{folder / name}: is damaged")
    sign(folder)  # even where somebody has signed it
    assert error_of(folder).startswith(f"{folder / name}: is no Parquet table (")


@pytest.mark.parametrize("name", FILES)
def test_a_missing_file_is_named(folder: Path, name: str) -> None:
    (folder / name).unlink()
    assert str(folder / name) in error_of(folder)


MANIFESTS: dict[str, tuple[str, str]] = {
    "no json": ("{", "cannot be read ("),
    "no mapping": ("[1]", 'is not of an exported study (which has "format": "tlr_exp study")'),
    "of a run": ('{"run_id": "1", "name": "a"}', "is not of an exported study"),
    "no version": ('{"format": "tlr_exp study"}', "format_version is None; it must be an integer"),
    "newer": (
        '{"format": "tlr_exp study", "format_version": 2, "tlr_exp": "9.0"}',
        "written in format version 2, this installation reads up to 1: install a newer tlr_exp "
        "(it was written by 9.0)",
    ),
    "no sums": (
        '{"format": "tlr_exp study", "format_version": 1, "sha256": {"runs.parquet": ""}}',
        "sha256 must name runs.parquet and curves.parquet",
    ),
}


@pytest.mark.parametrize("case", MANIFESTS)
def test_manifests_that_are_none(folder: Path, case: str) -> None:
    text, message = MANIFESTS[case]
    (folder / MANIFEST).write_text(text)
    line = error_of(folder)
    assert line.startswith(f"{folder / MANIFEST}: ")
    assert message in line


TABLES: dict[str, tuple[str, Callable[[pd.DataFrame], pd.DataFrame], str]] = {
    "no names": (RUNS, lambda t: t.drop(columns="run"), "the column run is missing"),
    "no arms": (RUNS, lambda t: t.drop(columns="arm"), "runs: the column arm is missing"),
    "no iterations": (
        CURVES,
        lambda t: t.drop(columns="iteration"),
        "curves: the column iteration is missing",
    ),
    "seeds as text": (
        RUNS,
        lambda t: t.assign(seed=t.seed.astype(str)),
        "runs: the column seed is str; it must be an integer",
    ),
    "metric as text": (
        CURVES,
        lambda t: t.assign(**{"ppo/kl": "low"}),
        "curves: the column ppo/kl is str; it must be a float",
    ),
    "lists": (
        RUNS,
        lambda t: t.assign(command=[["a"]] * len(t)),
        "runs: the column command is object; it must be text",
    ),
    "an iteration less": (
        CURVES,
        lambda t: t.drop(index=[0]),
        "finished, with 1 of 6 iterations missing: 1",
    ),
}


@pytest.mark.parametrize("case", TABLES)
def test_tables_that_are_no_study(folder: Path, case: str) -> None:
    name, change, message = TABLES[case]
    rewrite(folder, name, change)
    line = error_of(folder)
    assert line.startswith(str(folder))
    assert message in line


def test_a_baseline_that_is_no_arm(folder: Path) -> None:
    edit(folder, baseline="static")
    assert error_of(folder) == f"{folder}: baseline 'static' is no arm; arms: fixed, gwo"


# --- writing ---------------------------------------------------------------------------------
def test_nothing_is_overwritten_without_being_told(folder: Path, tmp_path: Path) -> None:
    (folder / "README.md").write_text("ours")
    before = {path.name: path.read_bytes() for path in folder.iterdir()}
    with pytest.raises(StudyError, match="is not empty; choose another folder, or force it"):
        write_tables(study(9), folder)
    assert {path.name: path.read_bytes() for path in folder.iterdir()} == before
    write_tables(study(9), folder, force=True)
    assert from_tables(folder).iterations == 9
    assert (folder / "README.md").read_text() == "ours"
    (tmp_path / "file").write_text("")
    with pytest.raises(StudyError, match="is a file; give the name of a folder"):
        write_tables(study(), tmp_path / "file", force=True)


def test_an_empty_folder_and_missing_parents_are_fine(tmp_path: Path) -> None:
    (tmp_path / "empty").mkdir()
    for folder in (tmp_path / "empty", tmp_path / "a" / "b"):
        write_tables(study(), folder)
        same(study(), from_tables(folder))


@pytest.mark.parametrize("occupied", [False, True])
def test_a_write_that_fails_leaves_what_was_there(
    tmp_path: Path, occupied: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "study"
    if occupied:
        write_tables(study(), folder)

    def full(path: Path, data: bytes) -> None:
        if path.name == CURVES:
            raise OSError(28, os.strerror(28))
        path.write_bytes(data)

    monkeypatch.setattr(tables, "write_through", full)
    with pytest.raises(StudyError, match=r"cannot write .*: No space left on device"):
        write_tables(study(9), folder, force=True)
    assert [path.name for path in tmp_path.iterdir()] == (["study"] if occupied else [])
    if occupied:
        same(study(), from_tables(folder))


def test_a_kill_between_the_replacements_is_noticed(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    real, done = os.replace, []

    def killed(source: Path, target: Path) -> None:
        if done:
            raise KeyboardInterrupt
        real(source, target)
        done.append(target)

    monkeypatch.setattr(os, "replace", killed)
    with pytest.raises(KeyboardInterrupt):
        write_tables(study(9), folder, force=True)
    monkeypatch.undo()
    assert "is damaged or was changed" in error_of(folder)
