"""tlr-evaluate --view and --web: what is handed to the viewers, and what is told without them."""

import pytest

from tlr_exp.commands import evaluate
from tlr_exp.viewing import native, web


@pytest.mark.parametrize(
    ("arguments", "port"), [(["--view"], None), (["--web"], 8080), (["--web", "0"], 0)]
)
def test_a_viewer_gets_the_roll_out_and_writes_nothing(
    untrained_run, shown_recordings, arguments, port, short_clip
):
    assert evaluate.main([str(untrained_run), *arguments]) == 0
    ((recording, given),) = shown_recordings
    assert given == port
    assert recording.title == "a-run, iteration 5, native physics"
    assert recording.num_frames == short_clip.num_frames - 2
    # What the first step was to reach is the third state of the clip (one step ahead).
    assert recording.reference_qpos[0] == pytest.approx(short_clip.qpos[2], abs=1e-5)
    assert "upper body" in recording.captions[0]
    assert not (untrained_run / "eval").exists()


def test_without_a_display_nothing_is_rolled_out(untrained_run, monkeypatch, capsys):
    monkeypatch.setattr(native.sys, "platform", "linux")
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    assert evaluate.main([str(untrained_run), "--view"]) == 2
    told = capsys.readouterr()
    assert told.err.startswith("tlr-evaluate: there is no display")
    assert told.err.count("\n") == 1
    assert told.out == ""


def test_without_viser_it_is_told_what_to_install(untrained_run, monkeypatch, capsys):
    monkeypatch.setattr(web, "find_spec", lambda name: None)
    assert evaluate.main([str(untrained_run), "--web"]) == 2
    told = capsys.readouterr()
    assert told.err == ("tlr-evaluate: --web needs viser and mjviser: pip install -e '.[web]'\n")
    assert told.out == ""


@pytest.mark.parametrize("both", [["--view", "--web"], ["--strip", "--view"]])
def test_one_thing_at_a_time(untrained_run, both):
    with pytest.raises(SystemExit) as exit_:
        evaluate.main([str(untrained_run), *both])
    assert exit_.value.code == 2
