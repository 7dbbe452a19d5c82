"""tlr-motion show: which files it leaves, and what it refuses."""

import numpy as np
import pytest

from tlr_exp.commands.motion import main
from tlr_exp.pictures import film, strips
from tlr_exp.pictures.graphics import GraphicsUnavailable, graphics_backend
from tlr_exp.viewing import web


@pytest.fixture
def unable(monkeypatch):
    """A machine without graphics."""

    def refuse(*_, **__):
        raise GraphicsUnavailable("no pictures: install EGL")

    monkeypatch.setattr(film, "render_frames", refuse)
    monkeypatch.setattr(strips, "render_frames", refuse)


def test_all_pictures_of_a_clip(short_clip_path, tmp_path, capsys):
    try:
        graphics_backend()
    except GraphicsUnavailable as error:
        pytest.skip(str(error))
    folder = tmp_path / "pictures"
    size = ["--size", "64x48", "--fps", "3", "--columns", "1"]
    assert main(["show", str(short_clip_path), "-o", str(folder), *size]) == 0
    names = ["short.mp4", "short_bodies.png", "short_joints.png", "short_keyframes.png"]
    assert sorted(path.name for path in folder.iterdir()) == names
    *lines, video = capsys.readouterr().out.splitlines()[1:]
    assert sorted(lines) == [str(folder / name) for name in names[1:]]
    # 50 / 3 is nearest to every 17th frame: 0, 17 and 34 of 41.
    assert video == f"{folder / names[0]}: 1.0 s, 3 frames at 2.94 fps"
    before = (folder / "short_joints.png").read_bytes()
    command = ["show", str(short_clip_path), "-o", str(folder), "--only", "joints"]
    assert main(command) == 1
    assert "short_joints.png exists; --force replaces it" in capsys.readouterr().err
    assert main([*command, "--force"]) == 0
    assert (folder / "short_joints.png").read_bytes() == before


@pytest.mark.usefixtures("unable")
def test_without_graphics_there_are_curves(short_clip_path, tmp_path, capsys):
    folder = tmp_path / "pictures"
    assert main(["show", str(short_clip_path), "-o", str(folder)]) == 1
    assert capsys.readouterr().err == "tlr-motion: no pictures: install EGL\n"
    names = sorted(path.name for path in folder.iterdir())
    assert names == ["short_bodies.png", "short_joints.png"]


@pytest.mark.usefixtures("unable")
def test_an_empty_folder_is_not_left_behind(short_clip_path, tmp_path):
    folder = tmp_path / "pictures"
    assert main(["show", str(short_clip_path), "-o", str(folder), "--only", "video"]) == 1
    assert not folder.exists()


@pytest.mark.parametrize(
    ("arguments", "message", "status"),
    [
        (["absent.npz"], "there is no motion clip absent.npz", 1),
        (["CLIP", "--columns", "0"], "--columns is 0", 2),
        (["CLIP", "--only", "video", "--fps", "0"], "frame rate is 0", 2),
        (["CLIP", "--web", "65536"], "--web is 65536", 2),
        (["CLIP", "--only", "keyframes", "--times", "0.1", "9"], "9 s is not within the clip", 1),
        (["CLIP", "-o", "no/folder"], "No such file", 1),
    ],
)
def test_what_is_refused_leaves_nothing(
    short_clip_path, tmp_path, monkeypatch, arguments, message, status, capsys
):
    monkeypatch.chdir(tmp_path)
    names = {"CLIP": str(short_clip_path)}
    shown = [str(names.get(argument, argument)) for argument in arguments]
    assert main(["show", *shown]) == status
    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("size", ["640", "63x48", "8x8", "100000x100000"])
def test_sizes_that_no_video_has(short_clip_path, size, capsys):
    with pytest.raises(SystemExit) as exit_:
        main(["show", str(short_clip_path), "--size", size])
    assert exit_.value.code == 2
    assert "--size" in capsys.readouterr().err


def test_times_are_taken_as_they_are(short_clip_path, tmp_path, monkeypatch):
    seen = []

    def draw(robot, recording, frames):
        seen.append(frames * recording.dt_s)
        return np.zeros((1, 1, 3), np.uint8)

    monkeypatch.setattr(strips, "keyframe_strip", draw)
    command = ["show", str(short_clip_path), "-o", str(tmp_path), "--only", "keyframes"]
    assert main([*command, "--times", "0.1", "0.5"]) == 0
    assert main([*command, "--columns", "3", "--force"]) == 0
    np.testing.assert_allclose(seen[0], [0.1, 0.5])
    np.testing.assert_allclose(seen[1], [0.0, 0.4, 0.8])


@pytest.mark.parametrize(
    ("arguments", "port"), [(["--view"], None), (["--web"], 8080), (["--web", "0"], 0)]
)
def test_a_viewer_gets_the_clip_and_nothing_is_written(
    short_clip, short_clip_path, tmp_path, monkeypatch, shown_recordings, arguments, port
):
    monkeypatch.chdir(tmp_path)
    assert main(["show", str(short_clip_path), *arguments]) == 0
    ((recording, given),) = shown_recordings
    assert given == port
    assert recording.title == "short: 41 frames at 50 fps, 0.80 s"
    np.testing.assert_array_equal(recording.qpos, short_clip.qpos)
    assert recording.reference_qpos is None
    assert list(tmp_path.iterdir()) == []


def test_without_a_viewer_it_is_said_in_one_line(short_clip_path, monkeypatch, capsys):
    monkeypatch.setattr(web, "find_spec", lambda name: None)
    assert main(["show", str(short_clip_path), "--web"]) == 1
    told = capsys.readouterr()
    assert told.err == "tlr-motion: --web needs viser and mjviser: pip install -e '.[web]'\n"
    assert told.out == ""
