"""A rival from outside the repository, as docs/architecture.md shows it: to the report."""

import os
import re
from pathlib import Path

import pytest
import torch
from stores import children, latest, statuses, tag

from analysis.commands import report
from tests.trainer import Trainer
from tlr_exp.commands import sync
from tlr_exp.records.checkpoint import CheckpointStore, load_checkpoint
from tlr_exp.records.run_directory import RunDirectory
from tlr_exp.records.sweep_directory import SweepDirectory

PAGE = Path(__file__).parents[2] / "docs" / "architecture.md"
CONSTANT = "ppo.final_learning_rate=null"  # so that a run can be made longer
SHORTER, LAST = 3, 6


@pytest.fixture
def own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    """The override that finds the files of the page, which lie in a folder of their own."""
    section = PAGE.read_text(encoding="utf-8").partition("### a rival of your own")[2]
    code, settings = (
        re.findall(f"```{kind}\n(.*?)```", section, re.DOTALL)[0] for kind in ("python", "yaml")
    )
    folder = tmp_path / "own"
    (folder / "conf" / "optimizer").mkdir(parents=True)
    (folder / "conf" / "optimizer" / "mine.yaml").write_text(settings)
    (folder / "my_rival.py").write_text(code)
    paths = [str(folder), os.environ.get("PYTHONPATH", "")]
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(filter(None, paths)))
    return f"hydra.searchpath=[file://{folder}/conf]"


def last_state(run: Path) -> dict:
    store = CheckpointStore(run / "checkpoints", keep_last=2)
    return load_checkpoint(store.path_of(LAST))["trainer"]


def weights_of(run: RunDirectory) -> list[list[float]]:
    return [
        [value for name, value in line.items() if name.startswith("weight/")]
        for line in run.metrics()
    ]


def test_a_rival_of_ones_own_is_a_method_like_any_other(
    trainer: Trainer, own: str, tmp_path: Path, database: Path, monkeypatch
) -> None:
    # A sweep of it and of the static reward.
    status, output = trainer.run("-m", own, "optimizer=mine,fixed", CONSTANT)
    assert status == 0, output
    runs = {run.manifest["tags"]["method"]: run for run in map(RunDirectory.open, trainer.runs)}
    assert set(runs) == {"mine", "fixed"}
    mine = runs["mine"]
    assert mine.path.name.startswith("demo-mine-seed0-")
    assert mine.config["optimizer"] == {"_target_": "my_rival.Agreement", "rate": 0.02}
    assert {round(weight, 2) for weight in weights_of(mine)[0]} <= {0.98, 1.0}
    assert weights_of(mine) != weights_of(runs["fixed"]) == [[1.0] * 6] * LAST
    assert -1.0 <= mine.metrics()[0]["optimizer/cosine/ang_vel_xy"] <= 1.0

    # Its identity: the same is not trained again, another setting is another run.
    status, output = trainer.run(own, "optimizer=mine", CONSTANT, "resume=auto")
    assert (status, "trained already" in output) == (0, True), output
    status, output = trainer.run(own, "optimizer=mine", CONSTANT, "optimizer.rate=2")
    assert (status, "optimizer.rate is 2; allowed: from 0 to 1" in output) == (2, True), output
    assert len(trainer.runs) == 2

    # Cut short and trained further, it has the same bits; without its module it says what it lacks.
    short = (own, "optimizer=mine", CONSTANT, f"scale.iterations={SHORTER}", "study=cut")
    assert trainer.run(*short)[0] == 0
    (cut,) = set(trainer.runs) - {run.path for run in runs.values()}
    further = (f"resume={cut}", f"scale.iterations={LAST}")
    with monkeypatch.context() as without:
        without.setenv("PYTHONPATH", os.environ["PYTHONPATH"].partition(os.pathsep)[2])
        status, output = Trainer.call(trainer.folder, *further)
        assert (status, "my_rival" in output, "Traceback" in output) == (2, True, False), output
    status, output = Trainer.call(trainer.folder, *further)
    assert status == 0, output
    assert weights_of(RunDirectory.open(cut)) == weights_of(mine)
    expected, found = (last_state(run)["ppo"]["actor"] for run in (mine.path, cut))
    assert all(torch.equal(expected[name], found[name]) for name in expected)

    # MLflow and the report call it by its name.
    (sweep,) = SweepDirectory.find(trainer.folder)
    assert sync.main([str(sweep.path), "--tracking-uri", f"sqlite:///{database}"]) == 0
    (parent,) = set(statuses(database)) - {run.path.name for run in runs.values()}
    assert children(database, parent) == {run.path.name for run in runs.values()}
    assert tag(database, mine.path.name, "method") == "mine"
    assert "optimizer/cosine/ang_vel_xy" in latest(database, mine.path.name)
    assert report.main([str(sweep.path), "-o", str(tmp_path / "report")]) == 0
    text = (tmp_path / "report" / "report.md").read_text()
    assert "mine" in text
    assert "static" in text
