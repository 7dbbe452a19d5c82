"""What is tried before a run is made, and which errors are told without a traceback."""

import subprocess
import sys

import numpy as np
import pytest

from tlr_exp.config.components import instantiate
from tlr_exp.config.load import ConfigError
from tlr_exp.machine.terminal import print_error
from tlr_exp.motion.clip import MotionClip, clip_from_qpos
from tlr_exp.records.metrics_file import DamagedMetricsError
from tlr_exp.records.run_directory import RunDirectory
from tlr_exp.training.loop import Training
from tlr_exp.training.run import check_inputs, check_lower_layer, check_world


def break_down(**arguments):
    """A part with a mistake of its own."""
    return len(arguments["num_terms"])


@pytest.mark.parametrize(
    ("overrides", "words"),
    [
        (["optimizer=effective_dimension", "optimizer.rest=2.0"], r"^optimizer.*rest .* 0 to 1"),
        (["optimizer=effective_dimension", "optimizer.levels=3"], r"^optimizer.*levels"),
        (
            ["optimizer=effective_dimension", "optimizer.inner.pack_size=2"],
            r"^optimizer\.inner.*pack_size .* at least 3",
        ),
        (["optimizer=ospo", "optimizer.elites=50"], r"^optimizer.* at least 50"),
        (["optimizer=curriculum", "optimizer.initial=2.0"], r"^optimizer.*initial .* 0 to 1"),
        (["+optimizer.colour=1"], r"no key optimizer\.colour\. Allowed in optimizer: .*pack_size"),
        (["optimizer.tie_break=last"], r"^optimizer.*tie_break is 'last'; .* first, largest_norm"),
        (["optimizer.pack_size=many"], r"^optimizer.*pack_size .*a whole number"),
        (["optimizer.lower=2.0"], r"^optimizer: lower 2\.0 and upper 1\.0"),
        (["reward.objective.threshold_share=1.5"], r"^reward\.objective\.threshold_share is 1\.5"),
        (["reward.objective.threshold_share=0.001"], r"^reward\.objective: .* num_envs >= 1000"),
        (["env.robot.gains=soft"], r"env\.robot\.gains is 'soft'; allowed: beyondmimic, asap"),
        (["physics.num_threads=-1"], r"^physics\.num_threads is -1; allowed: at least 0"),
        (["physics=mjx", "physics.impl=cuda"], r"^physics\.impl is 'cuda'; allowed: jax, warp"),
        (["physics=mjx", "physics.max_contacts=0"], r"^physics\.max_contacts is 0; .* at least 1"),
    ],
)
def test_what_only_a_part_refuses_is_a_mistake_of_the_configuration(settings_of, overrides, words):
    with pytest.raises(ConfigError, match=words):
        check_inputs(settings_of(*overrides))


def test_an_optimizer_is_not_refused_by_what_others_call_their_settings(settings_of):
    check_lower_layer(settings_of("optimizer=pso", "optimizer.pack_size=2"))


def test_a_package_that_is_missing_is_told_before_a_run_is_made(settings_of, monkeypatch):
    monkeypatch.setitem(sys.modules, "mealpy", None)
    with pytest.raises(ConfigError, match=r"pip install -e '\.\[mealpy\]'"):
        check_lower_layer(settings_of("optimizer=mealpy"))


def test_more_start_phases_than_the_motion_has_steps_are_refused(settings_of):
    check_world(settings_of("scale.evaluate_starts=39"))
    with pytest.raises(ConfigError, match="evaluate_starts is 40; the motion has only 39 steps"):
        check_world(settings_of("scale.evaluate_starts=40"))


@pytest.mark.parametrize(
    ("frames", "fps", "words"),
    [
        # 11 frames at 200 Hz last 50 ms: at 50 Hz these are frames 0, 20 and 40 ms.
        (11, 200.0, r"only 3 frames at the control rate of 50 Hz, and 5 are needed"),
        (3, 200.0, r"T >= 2"),
    ],
)
def test_frames_count_at_the_rate_of_the_control(
    settings_of, robot, short_clip, tmp_path, frames, fps, words
):
    path = tmp_path / "fast.npz"
    clip_from_qpos(np.array(short_clip.qpos[:frames]), fps, robot).save(path)
    settings = settings_of("env.reference_lead=3")
    check_world(settings)
    settings.env.motion = str(path)
    with pytest.raises(ConfigError, match=words):
        check_world(settings)


def test_a_part_that_breaks_is_told_with_its_traceback_and_a_wrong_key_without(capsys):
    for node, kind in (
        ({"_target_": f"{__name__}.break_down"}, TypeError),
        ({"_target_": "tlr_exp.optimizer.zero.ZeroWeights", "colour": 1}, ConfigError),
    ):
        with pytest.raises(kind) as error:
            instantiate("optimizer", node, num_terms=6, objective=None)
        print_error(error.value)
        printed = capsys.readouterr().err
        assert str(error.value) in printed
        assert ("in break_down" in printed) is (kind is TypeError)
        assert ("Traceback" in printed) is (kind is TypeError)


def test_failures_of_a_training_are_explained_and_others_are_not(capsys):
    print_error(DamagedMetricsError("metrics.jsonl, line 3: no metrics"))
    assert capsys.readouterr().err == "metrics.jsonl, line 3: no metrics\n"
    print_error(KeyError("a bug"))
    assert "KeyError: 'a bug'" in capsys.readouterr().err


def test_a_training_goes_on_with_what_its_check_has_built(settings_of, tmp_path):
    settings = settings_of("scale.num_envs=16", "ppo.hidden_sizes=[16]", "optimizer=gwo")
    parts = check_inputs(settings)
    again = check_inputs(settings).weight_optimizer
    training = Training(settings, RunDirectory.create(tmp_path / "run", {"seed": 0}, {}), parts)
    assert training.trainer.weight_optimizer is parts.weight_optimizer is not again
    assert training.trainer.box_sample.objective is parts.objective
    kept = MotionClip.load(training.run.motion_path, parts.robot.spec)
    np.testing.assert_array_equal(kept.qpos, parts.clip.qpos)


@pytest.mark.parametrize(
    ("module", "heavy"),
    [
        ("tlr_exp.commands.train", {"torch", "mujoco", "mlflow"}),
        ("tlr_exp.assembly.world", {"torch", "mlflow"}),
        ("analysis.report.study_tables", {"torch", "mujoco"}),
    ],
)
def test_pytorch_is_not_loaded_before_the_configuration_is_checked(module, heavy):
    script = f"import sys, {module}; print(*{heavy} & set(sys.modules))"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True)
    assert done.stdout == "\n", done
