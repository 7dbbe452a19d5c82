"""Which checkpoint is meant, by its name or by the run that it lies in."""

import json
from pathlib import Path

import pytest

from tlr_exp.records.checkpoint_files import chosen_checkpoint, initial_checkpoint


@pytest.fixture
def run(tmp_path: Path) -> Path:
    """Checkpoints of iterations 2, 4 and 6, of which 4 is the best."""
    folder = tmp_path / "run" / "checkpoints"
    folder.mkdir(parents=True)
    for iteration in (2, 4, 6):
        (folder / f"{iteration:06d}.pt").touch()
    (folder / "scores.json").write_text(json.dumps({"2": 0.1, "4": 0.3, "6": 0.2}))
    return tmp_path / "run"


@pytest.mark.parametrize(
    ("wanted", "iteration"), [(None, 4), ("best", 4), ("last", 6), ("2", 2), ("000002", 2)]
)
def test_a_checkpoint_is_found_by_its_name(run: Path, wanted: str | None, iteration: int) -> None:
    assert int(chosen_checkpoint(run / "checkpoints", wanted).stem) == iteration


def test_what_there_is_is_listed(run: Path) -> None:
    with pytest.raises(ValueError, match=r"no checkpoint '3'; it has 2, 4, 6, last, best"):
        chosen_checkpoint(run / "checkpoints", "3")
    (run / "checkpoints" / "scores.json").unlink()
    with pytest.raises(ValueError, match=r"no checkpoint 'best'; it has 2, 4, 6, last$"):
        chosen_checkpoint(run / "checkpoints", "best")
    assert chosen_checkpoint(run / "checkpoints").stem == "000006"


def test_a_run_begins_another_by_its_best_checkpoint_and_a_checkpoint_by_itself(run: Path) -> None:
    best = run / "checkpoints" / "000004.pt"
    assert initial_checkpoint(run) == best
    assert initial_checkpoint(best) == best


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("run/checkpoints/000009.pt", "there is no checkpoint .*000009.pt"),
        ("nowhere", "there is no folder .*nowhere; a run or a checkpoint"),
        (".", "is no run: it has no folder checkpoints"),
        ("empty", "empty/checkpoints holds no checkpoint yet"),
    ],
)
def test_nothing_to_begin_from_is_told(run: Path, name: str, words: str) -> None:
    (run.parent / "empty" / "checkpoints").mkdir(parents=True)
    with pytest.raises(ValueError, match=words):
        initial_checkpoint(run.parent / name)
