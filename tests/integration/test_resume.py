"""A run that was killed and resumed ends with the same policy, bit for bit."""

import hashlib
import json
import shutil
import signal
import time
from pathlib import Path

import pytest
import torch

from tests.patience import HANG_S
from tests.trainer import Trainer
from tlr_exp.records.checkpoint import CheckpointStore, load_checkpoint
from tlr_exp.records.directory import FINISHED, INTERRUPTED
from tlr_exp.records.run_directory import RunDirectory

LAST = 6


def final_state(run: Path) -> dict:
    return load_checkpoint(run / "checkpoints" / f"{LAST:06d}.pt")


def assert_same(left: object, right: object, where: str = "state") -> None:
    if isinstance(left, dict):
        assert left.keys() == right.keys(), where
        for key in left:
            assert_same(left[key], right[key], f"{where}[{key!r}]")
    elif isinstance(left, list | tuple):
        assert len(left) == len(right), where
        for index, (one, other) in enumerate(zip(left, right, strict=True)):
            assert_same(one, other, f"{where}[{index}]")
    elif isinstance(left, torch.Tensor):
        assert torch.equal(left, right), where
    else:
        assert left == right, where


def lines(run: Path) -> list[dict]:
    return RunDirectory.open(run).metrics()


def without_times(line: dict) -> dict:
    return {k: v for k, v in line.items() if not k.startswith("time/") and k != "wall_time"}


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory, short_clip_path):
    trainer = Trainer(tmp_path_factory.mktemp("undisturbed"), short_clip_path)
    status, output = trainer.run()
    assert status == 0, output
    return trainer.runs[0]


def wait_for_lines(run_root: Path, count: int, process) -> None:
    deadline = time.monotonic() + HANG_S
    while time.monotonic() < deadline and process.poll() is None:
        files = list(run_root.glob("runs/*/*/metrics.jsonl"))
        if files and files[0].read_bytes().count(b"\n") >= count:
            return
        time.sleep(0.005)


@pytest.mark.parametrize("kill_after", [1, 2, 5])
def test_sigkill_and_resume_end_with_the_same_bits(trainer, undisturbed, kill_after):
    process = trainer.start()
    wait_for_lines(trainer.folder, kill_after, process)
    process.kill()
    process.communicate()
    assert process.returncode == -signal.SIGKILL

    status, output = trainer.run("resume=auto")
    assert status == 0, output
    assert len(trainer.runs) == 1
    assert_same(final_state(trainer.runs[0]), final_state(undisturbed))
    resumed, alone = lines(trainer.runs[0]), lines(undisturbed)
    assert [line["iteration"] for line in resumed] == list(range(1, LAST + 1))
    assert json.dumps([without_times(line) for line in resumed]) == json.dumps(
        [without_times(line) for line in alone]
    )


def test_a_run_of_an_earlier_version_is_gone_on_with_by_its_path(trainer, undisturbed, tmp_path):
    """Killed, moved, without the keys that came later; the command repeats no override."""
    process = trainer.start()
    wait_for_lines(trainer.folder, 2, process)
    process.kill()
    process.communicate()
    (killed,) = trainer.runs
    moved = killed.rename(tmp_path / "moved")
    text = (moved / "config.yaml").read_text()
    earlier = text.replace("init_from: null\n", "")
    assert earlier != text
    (moved / "config.yaml").write_text(earlier)
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()

    status, output = Trainer.call(elsewhere, f"resume={moved}")
    assert status == 0, output
    assert not list(elsewhere.iterdir())
    assert_same(final_state(moved), final_state(undisturbed))
    assert [without_times(line) for line in lines(moved)] == [
        without_times(line) for line in lines(undisturbed)
    ]
    assert (moved / "config.yaml").read_text() == earlier


def test_a_run_that_is_trained_further_is_the_longer_run_to_the_bit(trainer):
    # A rate that falls towards the end would be another one in the longer run.
    constant = "ppo.final_learning_rate=null"
    assert trainer.run(constant, "study=undisturbed")[0] == 0
    (undisturbed,) = trainer.runs
    assert trainer.run(constant, f"scale.iterations={LAST // 2}")[0] == 0
    (run,) = set(trainer.runs) - {undisturbed}
    short = RunDirectory.open(run).manifest["identity"]
    status, output = Trainer.call(trainer.folder, f"resume={run}", f"scale.iterations={LAST}")
    assert status == 0, output
    assert_same(final_state(run), final_state(undisturbed))
    assert [without_times(line) for line in lines(run)] == [
        without_times(line) for line in lines(undisturbed)
    ]
    manifest = RunDirectory.open(run).manifest
    assert manifest["identity"] == RunDirectory.open(undisturbed).manifest["identity"] != short
    (entry,) = manifest["extended"]
    assert (entry["from_iteration"], entry["iterations"]) == (LAST // 2, LAST)
    assert (entry["former_iterations"], entry["former_identity"]) == (LAST // 2, short)
    assert RunDirectory.open(run).config["scale"]["iterations"] == LAST

    # The longer configuration has been trained, the shorter one has not.
    status, output = trainer.run(constant, "resume=auto")
    assert (status, "trained already" in output) == (0, True), output
    status, output = trainer.run(constant, "resume=auto", f"scale.iterations={LAST // 2}")
    assert status == 0, output
    assert len(trainer.runs) == 3


def test_a_run_that_trains_and_one_that_has_finished_are_not_gone_on_with(trainer):
    process = trainer.start("scale.iterations=1000")
    wait_for_lines(trainer.folder, 1, process)
    (run,) = trainer.runs
    status, output = Trainer.call(trainer.folder, f"resume={run}")
    process.kill()
    process.communicate()
    assert (status, "in use by another process" in output) == (2, True), output

    RunDirectory.open(run).set_status(FINISHED)
    status, output = Trainer.call(trainer.folder, f"resume={run}")
    assert status == 0
    assert "has finished its 1000 iterations" in output
    assert f"tlr-train resume={run} scale.iterations=N" in output
    status, output = Trainer.call(trainer.folder, f"resume={run}", "optimizer=fixed", "seed=3")
    assert status == 2
    assert f"start a new one with init_from={run} to change optimizer, seed" in output


def test_a_new_run_begins_with_the_policy_of_another(trainer, undisturbed):
    status, output = trainer.run("scale.iterations=1", "seed=5", f"init_from={undisturbed}")
    assert status == 0, output
    assert "begins with the policy and the critic of" in output
    (run,) = trainer.runs
    best = CheckpointStore(undisturbed / "checkpoints", keep_last=1).best()
    manifest, config = RunDirectory.open(run).manifest, RunDirectory.open(run).config
    assert config["init_from"] == str(best)
    assert manifest["files"]["init_from"] == hashlib.sha256(best.read_bytes()).hexdigest()
    before = RunDirectory.open(undisturbed).manifest["identity"]
    assert manifest["identity"] != before


def test_ctrl_c_writes_a_checkpoint_and_says_how_to_go_on(trainer, undisturbed):
    process = trainer.start()
    wait_for_lines(trainer.folder, 1, process)
    process.send_signal(signal.SIGINT)
    output, _ = process.communicate(timeout=HANG_S)
    assert process.returncode == 130, output
    run = RunDirectory.open(trainer.runs[0])
    assert f"tlr-train resume={run.path}" in output
    assert run.status == INTERRUPTED
    assert list((run.path / "checkpoints").glob("*.pt"))

    status, output = Trainer.call(trainer.folder, f"resume={run.path}")
    assert status == 0, output
    assert RunDirectory.open(trainer.runs[0]).status == FINISHED
    assert_same(final_state(trainer.runs[0]), final_state(undisturbed))


def test_a_finished_run_is_not_trained_again_and_never_overwritten(trainer, undisturbed):
    study = undisturbed.parent
    shutil.copytree(study, trainer.folder / "runs" / study.name)
    before = final_state(trainer.runs[0])
    status, output = trainer.run("resume=auto")
    assert status == 0
    assert "trained already" in output
    assert trainer.run()[0] == 0
    first, second = trainer.runs
    assert second.name == f"{first.name}-2"
    assert_same(final_state(first), before)
    assert_same(final_state(second), before)
