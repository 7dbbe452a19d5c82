"""What a run leaves behind, and what it says when it cannot run."""

import pytest

from tlr_exp import keys
from tlr_exp.records.run_directory import RunDirectory


@pytest.mark.parametrize("optimizer", ["fixed", "gwo", "random"])
def test_a_run_leaves_metrics_checkpoints_and_a_manifest(trainer, optimizer):
    status, output = trainer.run(f"optimizer={optimizer}")
    assert status == 0, output
    assert "best checkpoint" in output
    run = RunDirectory.open(trainer.runs[0])
    assert run.status == "finished"
    assert run.manifest["tags"]["method"] == optimizer
    lines = run.metrics()
    assert [line["iteration"] for line in lines] == [1, 2, 3, 4, 5, 6]
    assert [line[keys.ENV_STEPS] for line in lines] == [16 * 8 * i for i in range(1, 7)]
    weights = [v for k, v in lines[-1].items() if k.startswith(keys.WEIGHT_PREFIX)]
    assert len(weights) == 6
    if optimizer == "fixed":
        assert weights == [1.0] * 6
        assert lines[0][keys.OBJECTIVE_AFTER] == lines[0][keys.OBJECTIVE_BEFORE]
    if optimizer == "gwo":
        assert all(line[keys.OBJECTIVE_AFTER] <= line[keys.OBJECTIVE_BEFORE] for line in lines)
    evaluated = [line["iteration"] for line in lines if "eval/survival" in line]
    assert evaluated == [3, 6]


@pytest.mark.parametrize(
    ("mistake", "words"),
    [
        (["ppo.gamma=3"], "ppo.gamma is 3"),
        (["optimizer=ospo", "optimizer.elites=50"], "elites"),  # which only the optimizer refuses
    ],
)
def test_a_mistake_leaves_nothing_behind(trainer, mistake, words):
    status, output = trainer.run(*mistake)
    assert status == 2
    assert words in output
    assert "Traceback" not in output
    assert trainer.runs == []


def test_another_robots_model_is_refused_with_what_it_has(trainer):
    other = trainer.folder / "cart.xml"
    other.write_text(
        "<mujoco><worldbody><body name='cart'><joint name='slide' type='slide'/>"
        "<geom size='.1'/></body></worldbody></mujoco>"
    )
    status, output = trainer.run(f"env.robot.mjcf={other}")
    assert status == 2
    assert "slide" in output
    assert "Traceback" not in output
    assert trainer.runs == []


def test_a_folder_that_cannot_hold_runs_is_named(trainer):
    (trainer.folder / "taken").write_text("a file")
    status, output = trainer.run("runs_dir=taken")
    assert status == 1
    assert "taken" in output
    assert "Traceback" not in output
