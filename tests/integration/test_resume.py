"""A run that was killed and resumed ends with the same policy, bit for bit."""

import json
import signal
import time
from pathlib import Path

import pytest
import torch

from tlr_exp.records.checkpoint import load_checkpoint
from tlr_exp.records.run_directory import FINISHED, INTERRUPTED, RunDirectory

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
    from tests.integration.conftest import Trainer

    trainer = Trainer(tmp_path_factory.mktemp("undisturbed"), short_clip_path)
    status, output = trainer.run()
    assert status == 0, output
    return trainer.runs[0]


def wait_for_lines(run_root: Path, count: int, process) -> None:
    deadline = time.monotonic() + 120
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


def test_ctrl_c_writes_a_checkpoint_and_says_how_to_go_on(trainer, undisturbed):
    process = trainer.start()
    wait_for_lines(trainer.folder, 1, process)
    process.send_signal(signal.SIGINT)
    output, _ = process.communicate(timeout=120)
    assert process.returncode == 130, output
    assert "resume=auto" in output
    run = RunDirectory.open(trainer.runs[0])
    assert run.status == INTERRUPTED
    assert list((run.path / "checkpoints").glob("*.pt"))

    status, output = trainer.run("resume=auto")
    assert status == 0, output
    assert RunDirectory.open(trainer.runs[0]).status == FINISHED
    assert_same(final_state(trainer.runs[0]), final_state(undisturbed))


def test_a_finished_run_is_not_trained_again_and_never_overwritten(trainer):
    assert trainer.run()[0] == 0
    before = final_state(trainer.runs[0])
    status, output = trainer.run("resume=auto")
    assert status == 0
    assert "trained already" in output
    assert trainer.run()[0] == 0
    first, second = trainer.runs
    assert second.name == f"{first.name}-2"
    assert_same(final_state(first), before)
    assert_same(final_state(second), before)
