"""An exported policy: the same numbers as the run, without its places, and never half there."""

import json
import os
import re
import socket
from pathlib import Path

import numpy as np
import pytest

from tlr_exp.commands import evaluate
from tlr_exp.commands.evaluate import choose, comparing
from tlr_exp.commands.export_policy import main
from tlr_exp.export import folder as policy_folder
from tlr_exp.motion.clip import MotionClip
from tlr_exp.records.checkpoint import load_checkpoint
from tlr_exp.records.run_directory import RunDirectory
from tlr_exp.records.runs import find_run
from tlr_exp.robot.g1 import G1

BARE = ["--no-video", "--no-pictures"]


@pytest.fixture
def policy(trained_run, tmp_path) -> Path:
    output = tmp_path / "policies" / "short-gwo"
    assert main([str(trained_run), "-o", str(output)]) == 0
    return output


def numbers(folder: Path, output: Path, *more: str) -> dict:
    """What tlr-evaluate measures, without where the policy lies and how its motion is called."""
    assert evaluate.main([str(folder), "-o", str(output), *BARE, *more]) == 0
    (path,) = output.glob("*.json")
    record = json.loads(path.read_text())
    return {name: value for name, value in record.items() if name not in ("run", "motion")}


def tree(folder: Path) -> dict[str, bytes]:
    files = (path for path in folder.rglob("*") if path.is_file())
    return {str(path.relative_to(folder)): path.read_bytes() for path in files}


# --- the same policy -------------------------------------------------------------------------


@pytest.mark.parametrize("more", [(), ("--starts", "3")])
def test_evaluation_gives_the_same_numbers_as_the_run_wherever_the_folder_lies(
    trained_run, policy, tmp_path, more
):
    of_run = numbers(trained_run, tmp_path / "a", *more)
    assert numbers(policy, tmp_path / "b", *more) == of_run
    moved = tmp_path / "elsewhere" / "another name"
    moved.parent.mkdir()
    policy.rename(moved)
    assert numbers(moved, tmp_path / "c", *more) == of_run


@pytest.mark.parametrize(("wanted", "iteration"), [("1", 1), ("3", 3), ("last", 4)])
def test_the_checkpoint_asked_for_is_exported(trained_run, tmp_path, wanted, iteration):
    output = tmp_path / "policy"
    assert main([str(trained_run), "-o", str(output), "--checkpoint", wanted]) == 0
    assert choose(output).iteration == iteration
    of_run = numbers(trained_run, tmp_path / "a", "--checkpoint", wanted)
    assert numbers(output, tmp_path / "b") == of_run


def test_the_actor_and_its_normalisation_alone_are_kept(trained_run, policy):
    (file,) = (policy / "checkpoints").glob("*.pt")
    (kept,) = load_checkpoint(file)["trainer"]["ppo"].values()
    whole = load_checkpoint(trained_run / "checkpoints" / file.name)["trainer"]["ppo"]["actor"]
    assert kept.keys() == whole.keys()
    assert all(kept[name].equal(whole[name]) for name in whole)
    assert any(name.endswith("variance") for name in kept)


def test_a_run_of_an_earlier_version_that_keeps_no_clip_gives_its_motions(
    trained_run, policy, tmp_path
):
    bare = tmp_path / "bare"
    bare.mkdir()
    (bare / "checkpoints").symlink_to(trained_run / "checkpoints")
    for name in ("manifest.json", "config.yaml"):
        (bare / name).write_bytes((trained_run / name).read_bytes())
    manifest = json.loads((bare / "manifest.json").read_text())
    del manifest["files"]
    (bare / "manifest.json").write_text(json.dumps(manifest))
    assert main([str(bare), "-o", str(tmp_path / "policy")]) == 0
    ours, others = (MotionClip.load(f / "motion.npz", G1) for f in (tmp_path / "policy", policy))
    assert np.array_equal(ours.qpos, others.qpos)


# --- what the commands make of it ------------------------------------------------------------


def test_an_evaluation_writes_into_the_folder(policy):
    assert evaluate.main([str(policy), *BARE]) == 0
    assert [path.suffix for path in (policy / "eval").iterdir()] == [".json"]


def test_viewers_show_it(policy, shown_recordings):
    for viewer in ("--web", "--view"):
        assert evaluate.main([str(policy), viewer]) == 0
    titles = [recording.title for recording, _ in shown_recordings]
    assert [title.split(",")[0] for title in titles] == ["short-gwo", "short-gwo"]


def test_strips_draw_it_beside_its_run(policy, trained_run, tmp_path, monkeypatch):
    drawn = []

    def draw(robot, rows, **options):
        drawn.append([row.result.upper_body_error_m for row in rows])
        return np.zeros((1, 1, 3), np.uint8)

    monkeypatch.setattr(comparing, "policy_strip", draw)
    monkeypatch.setattr(comparing, "graphics_backend", lambda: "none")
    command = [str(policy), str(trained_run), "--strip", "--checkpoint", "best"]
    assert evaluate.main([*command, "-o", str(tmp_path / "strip.png")]) == 0
    ((of_policy, of_run),) = drawn
    assert of_policy == of_run


def test_a_policy_can_be_exported_again_and_is_the_same(policy, tmp_path):
    assert main([str(policy), "-o", str(tmp_path / "again")]) == 0
    assert tree(tmp_path / "again") == tree(policy)


def test_a_training_never_goes_on_in_it(policy, trained_run):
    assert find_run(policy.parent, "0123abcd") is None
    assert find_run(trained_run.parent, "0123abcd") is not None


# --- what it tells ---------------------------------------------------------------------------


def test_the_manifest_says_where_the_policy_comes_from(trained_run, policy):
    of_run, ours = (RunDirectory.open(path).manifest for path in (trained_run, policy))
    assert ours["status"] == "finished"
    for name in ("name", "seed", "git", "tlr_exp", "packages", "python", "files", "created_at"):
        assert ours[name] == of_run[name]
    assert ours["machine"].keys() == {"cpu_count", "cpu_model", "device"}
    assert ours["tags"] == {"method": "gwo", "motion": "short.npz"}
    origin = ours["policy"]
    assert (origin["run_id"], origin["identity"]) == (of_run["run_id"], "0123abcd")
    (row,) = (
        row
        for row in RunDirectory.open(trained_run).metrics()
        if row["iteration"] == origin["iteration"]
    )
    assert origin["evaluation"]["eval/survival"] == row["eval/survival"]
    assert all(name.startswith("eval/") for name in origin["evaluation"])


def test_it_names_no_place_user_or_host(trained_run, policy):
    told = (policy / "manifest.json").read_text() + (policy / "config.yaml").read_text()
    for secret in ("/home", "ann", "srv.lab", str(trained_run.parent), socket.gethostname()):
        assert re.search(rf"(?<!\w){re.escape(secret)}(?!\w)", told) is None, secret
    assert "://" not in told
    for value in leaves(RunDirectory.open(policy).config):
        assert not os.path.isabs(str(value))


def test_the_configuration_keeps_what_is_learned_and_names_no_place():
    config = {
        "env": {"motion": "/home/ann/walk.yaml", "reference_lead": 1},
        "runs_dir": "/home/ann/runs",
        "tracking_uri": "sqlite:////home/ann/mlflow.db",
        "init_from": "/home/ann/runs/x/checkpoints/000007.pt",
    }
    assert policy_folder.policy_config(config) == {
        "env": {"motion": "walk.yaml", "reference_lead": 1},
        "runs_dir": "runs",
        "tracking_uri": "none",
        "init_from": None,
    }
    assert policy_folder.policy_config({"seed": 1}) == {"seed": 1}


def leaves(value):
    if isinstance(value, dict):
        for item in value.values():
            yield from leaves(item)
    else:
        yield value


# --- what it refuses -------------------------------------------------------------------------


def refused(capsys, *arguments: object) -> str:
    assert main([str(argument) for argument in arguments]) == 2
    error = capsys.readouterr().err
    assert error.startswith("tlr-export-policy: ")
    assert error.count("\n") == 1
    return error


def test_a_form_that_is_not_known_is_named_before_the_run_is_read(tmp_path, capsys):
    error = refused(capsys, tmp_path / "no-run", "-o", tmp_path / "policy.pb")
    assert "'.pb'" in error
    assert "no-run" not in error


def test_a_policy_is_replaced_by_force_alone(trained_run, policy, capsys):
    (policy / "eval").mkdir()
    before = tree(policy)
    error = refused(capsys, trained_run, "-o", policy, "--checkpoint", "1")
    assert "--force replaces it" in error
    assert tree(policy) == before
    assert main([str(trained_run), "-o", str(policy), "--checkpoint", "1", "--force"]) == 0
    assert choose(policy).iteration == 1
    assert not (policy / "eval").exists()
    assert [path.name for path in policy.parent.iterdir()] == [policy.name]


def test_nothing_but_a_policy_is_replaced_even_by_force(trained_run, tmp_path, capsys):
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "letter.txt").write_text("dear")
    (tmp_path / "file").write_text("a file")
    for output in (trained_run, tmp_path / "mine", tmp_path / "file"):
        assert "is no exported policy" in refused(capsys, trained_run, "-o", output, "--force")
    assert (tmp_path / "mine" / "letter.txt").read_text() == "dear"
    assert (trained_run / "metrics.jsonl").is_file()


@pytest.mark.parametrize("there", [False, True])
def test_an_error_on_the_way_leaves_what_was_there(
    trained_run, tmp_path, monkeypatch, capsys, there
):
    output = tmp_path / "policies" / "p"
    if there:
        assert main([str(trained_run), "-o", str(output)]) == 0
    before = tree(output)

    def full(path, data):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(policy_folder, "atomic_write", full)
    error = refused(capsys, trained_run, "-o", output, "--force")
    assert "No space left" in error
    assert tree(output) == before
    assert [path.name for path in output.parent.iterdir()] == ([output.name] if there else [])


def test_a_robot_model_of_ones_own_is_named(trained_run, tmp_path, capsys, monkeypatch):
    choice = choose(trained_run)
    choice.settings.env.robot.mjcf = "/home/ann/my_g1.xml"
    monkeypatch.setattr("tlr_exp.evaluation.choosing.choose", lambda *_: choice)
    error = refused(capsys, trained_run, "-o", tmp_path / "p")
    assert "env.robot.mjcf: my_g1.xml" in error
    assert not (tmp_path / "p").exists()


def test_what_is_no_run_or_checkpoint_is_named(trained_run, tmp_path, capsys):
    assert "no-run" in refused(capsys, tmp_path / "no-run", "-o", tmp_path / "p")
    error = refused(capsys, trained_run, "-o", tmp_path / "p", "--checkpoint", "77")
    assert "'77'" in error
    assert not (tmp_path / "p").exists()
