"""tlr-evaluate on a run directory: what it writes, which checkpoint it takes, what it refuses."""

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest
import torch

from tlr_exp.assembly.learner import build_ppo
from tlr_exp.commands import evaluate
from tlr_exp.commands.evaluate import measuring
from tlr_exp.evaluation.choosing import load_policy
from tlr_exp.pictures import film, graphics, strips
from tlr_exp.records.checkpoint import CheckpointError, CheckpointStore
from tlr_exp.records.run_directory import RunDirectory

ITERATIONS = {3: -0.9, 6: -0.2, 9: -0.5}  # of the checkpoints, with the scores they were given


@pytest.fixture(scope="module")
def run(settings_of, tmp_path_factory) -> Path:
    """A run directory with three checkpoints, whose policies were drawn and not trained."""
    settings = settings_of("ppo.hidden_sizes=[16]", "scale.num_envs=16")
    path = tmp_path_factory.mktemp("runs") / "a-run"
    RunDirectory.create(path, dataclasses.asdict(settings), tags={})
    store = CheckpointStore(path / "checkpoints", keep_last=3)
    for iteration, score in ITERATIONS.items():
        ppo = build_ppo(dataclasses.replace(settings, seed=iteration))
        store.save(iteration, {"trainer": {"ppo": ppo.state_dict()}, "simulation": {}}, score)
    return path


@pytest.fixture
def no_graphics(monkeypatch):
    """A machine that cannot draw."""
    monkeypatch.setenv("MUJOCO_GL", "disable")
    graphics.graphics_backend.cache_clear()
    yield
    graphics.graphics_backend.cache_clear()


def evaluated(folder: Path, *arguments: object) -> dict:
    """Run tlr-evaluate without pictures and read the one JSON file that it writes."""
    bare = ["--no-video", "--no-pictures", "-o", str(folder)]
    assert evaluate.main([*(str(a) for a in arguments), *bare]) == 0
    (path,) = folder.glob("*.json")
    return json.loads(path.read_text())


# --- what it writes --------------------------------------------------------------------------


def test_a_run_is_evaluated_without_giving_its_configuration(run, tmp_path, capsys, short_clip):
    record = evaluated(tmp_path, run)
    assert record["iteration"] == 6  # the best
    assert record["physics"] == "native"
    assert record["num_steps"] == short_clip.num_frames - 2
    assert 0.0 <= record["survival"] <= record["upright"] <= 1.0
    assert 0.0 < record["upper_body_error_m"] < 3.0
    assert "base_height" in record["terms"]
    shown = capsys.readouterr().out
    assert f"{record['upper_body_error_m']:.4f}" in shown
    assert "000006-native.json" in shown


def test_the_same_checkpoint_gives_the_same_numbers(run, tmp_path):
    first = evaluated(tmp_path / "a", run)
    assert evaluated(tmp_path / "b", run) == first
    other = evaluated(tmp_path / "c", run, "--checkpoint", "last")
    assert other["upper_body_error_m"] != first["upper_body_error_m"]


def test_results_go_into_the_run_by_default(run):
    assert evaluate.main([str(run), "--no-video", "--no-pictures"]) == 0
    assert [path.name for path in (run / "eval").iterdir()] == ["000006-native.json"]


def test_pictures_and_video_lie_beside_the_table(run, tmp_path):
    try:
        graphics.graphics_backend()
    except graphics.GraphicsUnavailable as error:
        pytest.skip(str(error))
    small = ["--size", "64x48", "--quality", "fast", "--columns", "2"]
    assert evaluate.main([str(run), "-o", str(tmp_path), *small]) == 0
    assert {path.name for path in tmp_path.iterdir()} == {
        "000006-native.json",
        *(f"000006-native_{kind}.png" for kind in ("joints", "bodies", "keyframes")),
        "000006-native.mp4",
    }


def test_the_strip_of_a_measured_run_has_its_own_size(run, tmp_path, monkeypatch):
    """--size and --quality are the video's: a strip of 8 pictures that large takes minutes."""
    asked = {}

    def draw(robot, rows, **options):
        asked["strip"] = options
        return np.zeros((1, 1, 3), np.uint8)

    monkeypatch.setattr(measuring, "graphics_backend", lambda: "none")
    monkeypatch.setattr(strips, "policy_strip", draw)
    monkeypatch.setattr(film, "film", lambda *_, **options: asked.update(options))
    command = [str(run), "-o", str(tmp_path), "--size", "1280x720", "--quality", "full"]
    assert evaluate.main([*command, "--columns", "3"]) == 0
    assert asked.pop("strip").keys() == {"title", "columns"}
    assert asked == {"width": 1280, "height": 720, "quality": "full"}


@pytest.mark.usefixtures("no_graphics")
def test_pictures_are_not_replaced_unasked_and_not_after_the_roll_out(
    run, tmp_path, monkeypatch, capsys
):
    (tmp_path / "000006-native_joints.png").write_text("mine")
    with monkeypatch.context() as patch:
        patch.setattr(measuring, "evaluate_starts", None)  # which is not to be called
        assert evaluate.main([str(run), "-o", str(tmp_path)]) == 2
    assert "000006-native_joints.png exists; --force replaces it" in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["000006-native_joints.png"]
    assert evaluate.main([str(run), "-o", str(tmp_path), "--force"]) == 0
    assert (tmp_path / "000006-native_joints.png").read_bytes().startswith(b"\x89PNG")


def test_numbers_are_replaced_unasked_by_the_same_alone(run, tmp_path, capsys):
    record = evaluated(tmp_path, run)
    assert evaluated(tmp_path, run) == record
    assert "000006-native.json holds the same already" in capsys.readouterr().out
    (tmp_path / "000006-native.json").write_text("{}")
    bare = [str(run), "--no-video", "--no-pictures", "-o", str(tmp_path)]
    assert evaluate.main(bare) == 2
    assert "000006-native.json exists; --force replaces it" in capsys.readouterr().err
    assert (tmp_path / "000006-native.json").read_text() == "{}"
    assert evaluated(tmp_path, run, "--force") == record


CURVES = [".json", "_bodies.png", "_joints.png"]


@pytest.mark.usefixtures("no_graphics")
def test_without_graphics_there_are_numbers_and_curves(run, tmp_path, capsys):
    assert evaluate.main([str(run), "-o", str(tmp_path)]) == 0
    names = sorted(path.name.removeprefix("000006-native") for path in tmp_path.iterdir())
    assert names == CURVES
    assert capsys.readouterr().err.startswith("no pictures: MUJOCO_GL")


@pytest.mark.usefixtures("no_graphics")
@pytest.mark.parametrize("asked", ["--video", "--pictures"])
def test_what_was_asked_for_and_cannot_be_drawn_is_an_error(run, tmp_path, capsys, asked):
    assert evaluate.main([str(run), asked, "-o", str(tmp_path)]) == 2
    names = sorted(path.name.removeprefix("000006-native") for path in tmp_path.iterdir())
    assert names == CURVES
    assert "no pictures" in capsys.readouterr().err


@pytest.mark.slow
def test_what_was_trained_on_one_engine_is_evaluated_on_the_other(run, tmp_path, monkeypatch):
    monkeypatch.setenv("NPROC", "1")  # JAX may have been imported before its engine was asked for
    native = evaluated(tmp_path / "native", run)
    mjx = evaluated(tmp_path / "mjx", run, "--physics", "mjx")
    assert mjx["physics"] == "mjx"
    assert mjx["num_steps"] == native["num_steps"]
    # The same fall of the same policy; contacts differ in the last digits and then grow apart.
    assert mjx["upper_body_error_m"] == pytest.approx(native["upper_body_error_m"], rel=0.2)


# --- which checkpoint ------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("wanted", "iteration"), [(None, 6), ("best", 6), ("last", 9), ("3", 3), ("000009", 9)]
)
def test_a_checkpoint_is_chosen_by_name_or_iteration(run, wanted, iteration):
    assert evaluate.choose(run, wanted).iteration == iteration


def test_a_checkpoint_file_names_its_run(run):
    choice = evaluate.choose(run / "checkpoints" / "000003.pt")
    assert (choice.run, choice.iteration) == (run, 3)


def test_the_policy_is_that_of_the_checkpoint(run):
    choice = evaluate.choose(run, "9")
    expected = build_ppo(dataclasses.replace(choice.settings, seed=9)).actor.state_dict()
    loaded = load_policy(choice).state_dict()
    assert all(torch.equal(loaded[name], tensor) for name, tensor in expected.items())


# --- what it refuses -------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--checkpoint", "4"], ["4", "3, 6, 9, last, best"]),
        (["--checkpoint", "newest"], ["newest", "best"]),
        (["--physics", "bullet"], ["bullet", "allowed are", "native"]),
        (["--iterations", "3"], ["--iterations needs --strip"]),
        (["other-run"], ["2 runs can be compared with --strip"]),
        (["--columns", "0"], ["--columns is 0"]),
        (["--starts", "0"], ["--starts is 0"]),
        (["--starts", "2", "--web"], ["--starts is for numbers"]),
        (["--starts", "40"], ["--starts is 40", "only 39 steps"]),
        (["--web", "65536"], ["--web is 65536"]),
    ],
)
def test_mistakes_are_told_in_one_line_with_what_there_is(run, capsys, arguments, words):
    assert evaluate.main([str(run), *arguments]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    for word in words:
        assert word in error


def test_what_is_no_run_is_named(tmp_path, capsys):
    assert evaluate.main([str(tmp_path / "nothing")]) == 2
    assert "nothing is not a directory" in capsys.readouterr().err
    assert evaluate.main([str(tmp_path)]) == 2
    assert "manifest.json" in capsys.readouterr().err


def test_a_run_without_checkpoints_is_named(run, tmp_path):
    RunDirectory.create(tmp_path / "new", RunDirectory.open(run).config, tags={})
    with pytest.raises(ValueError, match="holds no checkpoint"):
        evaluate.choose(tmp_path / "new")


def test_a_damaged_checkpoint_is_named(run, tmp_path, capsys):
    copy = tmp_path / "copy"
    RunDirectory.create(copy, RunDirectory.open(run).config, tags={})
    (copy / "checkpoints").mkdir()
    whole = (run / "checkpoints" / "000006.pt").read_bytes()
    (copy / "checkpoints" / "000006.pt").write_bytes(whole[: len(whole) // 2])
    assert evaluate.main([str(copy)]) == 2
    assert "000006.pt" in capsys.readouterr().err


def test_a_checkpoint_of_another_network_is_refused(run):
    choice = evaluate.choose(run)
    ppo = dataclasses.replace(choice.settings.ppo, hidden_sizes=[24])
    other = dataclasses.replace(choice.settings, ppo=ppo)
    with pytest.raises(CheckpointError, match="no policy of this configuration"):
        load_policy(dataclasses.replace(choice, settings=other))
