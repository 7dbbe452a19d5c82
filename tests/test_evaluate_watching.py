"""tlr-evaluate --view and --web: what is handed to the viewers, and what is told without them."""

import dataclasses
from pathlib import Path

import pytest

from tlr_exp import evaluate
from tlr_exp.assembly import build_ppo
from tlr_exp.records.checkpoint import CheckpointStore
from tlr_exp.records.run_directory import RunDirectory
from tlr_exp.viewing import native, web


@pytest.fixture(scope="module")
def run(settings_of, tmp_path_factory) -> Path:
    """A run directory with one checkpoint, whose policy was drawn and not trained."""
    settings = settings_of("ppo.hidden_sizes=[16]", "scale.num_envs=16")
    path = tmp_path_factory.mktemp("runs") / "a-run"
    RunDirectory.create(path, dataclasses.asdict(settings), tags={})
    state = {"trainer": {"ppo": build_ppo(settings).state_dict()}}
    CheckpointStore(path / "checkpoints", keep_last=1).save(5, state)
    return path


@pytest.mark.parametrize(
    ("arguments", "port"), [(["--view"], None), (["--web"], 8080), (["--web", "0"], 0)]
)
def test_a_viewer_gets_the_roll_out_and_writes_nothing(
    run, monkeypatch, arguments, port, short_clip
):
    shown = []
    monkeypatch.setattr(native, "require_display", lambda: None)
    monkeypatch.setattr(web, "require_packages", lambda: None)
    monkeypatch.setattr(native, "view", lambda recording, robot: shown.append((recording, None)))
    monkeypatch.setattr(
        web, "serve", lambda recording, robot, port: shown.append((recording, port))
    )
    assert evaluate.main([str(run), *arguments]) == 0
    ((recording, given),) = shown
    assert given == port
    assert recording.title == "a-run, iteration 5, native physics"
    assert recording.num_frames == short_clip.num_frames - 2
    # What the first step was to reach is the third state of the clip (one step ahead).
    assert recording.reference_qpos[0] == pytest.approx(short_clip.qpos[2], abs=1e-5)
    assert "upper body" in recording.captions[0]
    assert not (run / "eval").exists()


def test_without_a_display_nothing_is_rolled_out(run, monkeypatch, capsys):
    monkeypatch.setattr(native.sys, "platform", "linux")
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    assert evaluate.main([str(run), "--view"]) == 2
    told = capsys.readouterr()
    assert told.err.startswith("tlr-evaluate: there is no display")
    assert told.err.count("\n") == 1
    assert told.out == ""


def test_without_viser_it_is_told_what_to_install(run, monkeypatch, capsys):
    monkeypatch.setattr(web, "find_spec", lambda name: None)
    assert evaluate.main([str(run), "--web"]) == 2
    told = capsys.readouterr()
    assert told.err == ("tlr-evaluate: --web needs viser and mjviser: pip install 'tlr_exp[web]'\n")
    assert told.out == ""


@pytest.mark.parametrize("both", [["--view", "--web"], ["--strip", "--view"]])
def test_one_thing_at_a_time(run, both):
    with pytest.raises(SystemExit) as exit_:
        evaluate.main([str(run), *both])
    assert exit_.value.code == 2
