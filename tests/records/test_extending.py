"""A run that is trained further: what its manifest and its configuration say, whatever happens."""

from pathlib import Path

import pytest

from tlr_exp.records import extending
from tlr_exp.records.directory import FINISHED, RUNNING
from tlr_exp.records.extending import (
    complete_extension,
    extend,
    extensions,
    former_totals,
    total_iterations,
)
from tlr_exp.records.run_directory import RunDirectory

CONFIG = {"seed": 0, "scale": {"name": "demo", "iterations": 10}, "reward": {"b": 1, "a": 2}}


@pytest.fixture
def run(tmp_path: Path) -> RunDirectory:
    run = RunDirectory.create(tmp_path / "run", CONFIG, {}, identity="0000aaaa")
    run.set_status(FINISHED)
    return run


def test_a_run_that_was_never_extended_says_nothing_of_it(run: RunDirectory) -> None:
    before = (run.path / "config.yaml").read_bytes()
    complete_extension(run)
    assert (run.path / "config.yaml").read_bytes() == before
    assert extensions(run.manifest) == former_totals(run.manifest) == []
    assert total_iterations(run) == 10


def test_each_extension_is_kept_with_what_the_run_was_before(run: RunDirectory) -> None:
    run_id = run.manifest["run_id"]
    extend(run, 20, done=10, identity="1111bbbb")
    extend(run, 15, done=12, identity="2222cccc")
    manifest = run.manifest
    assert (manifest["run_id"], manifest["identity"]) == (run_id, "2222cccc")
    assert manifest["status"] == RUNNING
    entries = [{k: v for k, v in e.items() if k != "at"} for e in extensions(manifest)]
    assert entries == [
        {
            "from_iteration": 10,
            "iterations": 20,
            "former_iterations": 10,
            "former_identity": "0000aaaa",
        },
        {
            "from_iteration": 12,
            "iterations": 15,
            "former_iterations": 20,
            "former_identity": "1111bbbb",
        },
    ]
    assert former_totals(manifest) == [10, 20]
    assert total_iterations(run) == 15
    assert run.config == {**CONFIG, "scale": {"name": "demo", "iterations": 15}}
    assert list(run.config["reward"]) == ["b", "a"]  # the order of the terms is part of a run


def test_a_kill_between_the_two_files_is_made_good(run: RunDirectory, monkeypatch) -> None:
    with monkeypatch.context() as context:
        context.setattr(extending, "complete_extension", lambda _: None)
        extend(run, 20, done=10, identity="1111bbbb")
    assert run.config["scale"]["iterations"] == 10
    assert total_iterations(run) == 20
    complete_extension(run)
    assert run.config["scale"]["iterations"] == 20
    assert len(extensions(run.manifest)) == 1
