"""tlr-motion check, --fix and join: what they print, write, refuse, and their exit status."""

import json

import numpy as np
import pytest

from tlr_exp.commands.motion import main
from tlr_exp.motion.clip import MotionClip, clip_from_qpos
from tlr_exp.motion.quality.floor import floor_contacts
from tlr_exp.robot.g1 import G1


@pytest.fixture
def paths(tmp_path, short_clip, robot):
    """Files of the short clip: ``good`` (on the floor), ``high`` and ``deep`` by 30 and 40 mm."""
    files, lowest = {}, floor_contacts(short_clip, robot).lowest.min()
    for name, height in (("good", 0.0), ("high", 0.03), ("deep", -0.04)):
        qpos = short_clip.qpos.copy()
        qpos[:, 2] += height - lowest
        files[name] = tmp_path / f"{name}.npz"
        clip_from_qpos(qpos, 50.0, robot).save(files[name])
    return files


def test_a_table_a_clip_and_the_status_of_the_worst(paths, capsys):
    assert main(["check", str(paths["high"])]) == 0
    out = capsys.readouterr().out
    (floating,) = (line for line in out.splitlines() if "floating" in line)
    assert "30.0 mm" in floating
    assert "warn" in floating
    assert main(["check", str(paths["good"]), str(paths["deep"])]) == 1
    out = capsys.readouterr().out
    assert out.count("41 frames at 50 fps, 0.80 s") == 2
    (floor,) = (line for line in out.splitlines() if "40.0 mm" in line)
    assert "fail" in floor
    assert "ankle_roll_link" in floor


def test_json(paths, capsys):
    assert main(["check", "--json", str(paths["deep"])]) == 1
    (clip,) = json.loads(capsys.readouterr().out)["clips"]
    assert (clip["clip"], clip["frames"], clip["verdict"]) == (str(paths["deep"]), 41, "fail")
    floor = next(f for f in clip["findings"] if f["measure"] == "in the floor")
    assert floor["value"] == pytest.approx(40.0)
    assert (floor["unit"], floor["ok"], floor["fail"], floor["frames"]) == ("mm", 5.0, 30.0, 41)


def test_a_file_that_is_no_clip_fails_and_the_others_are_checked(paths, tmp_path, capsys):
    rubbish = tmp_path / "rubbish.npz"
    rubbish.write_text("no clip")
    assert main(["check", "--json", str(rubbish), str(paths["good"])]) == 1
    captured = capsys.readouterr()
    first, second = json.loads(captured.out)["clips"]
    assert "cannot read the motion clip" in first["error"]
    assert second["verdict"] != "fail"
    assert captured.err.count("\n") == 1


def test_fix_writes_the_clip_and_says_what_it_changed(paths, tmp_path, capsys):
    before, output = paths["deep"].read_bytes(), tmp_path / "fixed.npz"
    assert main(["check", "--fix", str(paths["deep"]), "-o", str(output)]) == 0
    good = MotionClip.load(paths["good"], G1)
    np.testing.assert_allclose(MotionClip.load(output, G1).qpos, good.qpos, atol=1e-9)
    assert f"{paths['deep']}: moved the whole clip by +40.0 mm" in capsys.readouterr().out
    assert paths["deep"].read_bytes() == before


def test_fix_says_what_it_left(paths, tmp_path, robot, capsys):
    """A robot that slides at 0.6 m/s: to plant its feet would be to invent another motion."""
    qpos = np.tile(MotionClip.load(paths["good"], G1).qpos[0], (41, 1))
    qpos[:, 1] += 0.6 * np.arange(41) / 50
    sliding, output = tmp_path / "sliding.npz", tmp_path / "fixed.npz"
    clip_from_qpos(qpos, 50.0, robot).save(sliding)
    command = ["check", "--fix", str(sliding), "-o", str(output)]
    assert main(command) == 1
    out = capsys.readouterr().out
    assert "nothing to change" in out
    assert "Not repaired" in out
    assert "foot sliding" in out.splitlines()[-1]
    assert MotionClip.load(output, G1).num_frames == 41
    assert main([*command, "--force", "--json"]) == 1
    data = json.loads(capsys.readouterr().out)
    assert data["changes"] == []
    assert data["before"]["verdict"] == data["clips"][0]["verdict"] == "fail"


def test_join_writes_one_clip(paths, tmp_path, capsys):
    output = tmp_path / "joined.npz"
    clips = [str(paths["good"]), str(paths["high"])]
    assert main(["join", *clips, "-o", str(output), "--blend", "0.4"]) == 0
    joined = MotionClip.load(output, G1)
    assert joined.num_frames == 81
    out = capsys.readouterr().out
    assert f"{paths['high']}: begins at 0.80 s, turned by 4.6° and moved by" in out
    assert "height -30.0 mm" in out
    assert "floating" in out


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["check", "absent.npz"], "there is no motion clip absent.npz"),
        (["check", __file__], "is not a clip; if it is a motion of another project, make a clip"),
        (["check", "absent"], "there is no motion 'absent'"),
        (["check", "GOOD", "--fix", "-o", "GOOD", "--force"], "would replace the file"),
        (["check", "GOOD", "--fix", "-o", "HIGH"], "high.npz exists; --force replaces it"),
        (["join", "GOOD", "GOOD", "-o", "OUT", "--blend", "5"], "shorter than the blend of 5 s"),
        (["join", "GOOD", "HIGH", "-o", "HIGH", "--force"], "would replace the file"),
        (["join", "GOOD", "absent.npz", "-o", "OUT"], "there is no motion clip absent.npz"),
    ],
)
def test_what_is_refused_leaves_nothing_behind(paths, tmp_path, arguments, message, capsys):
    before = {path: path.read_bytes() for path in tmp_path.iterdir()}
    names = {"GOOD": paths["good"], "HIGH": paths["high"], "OUT": tmp_path / "out.npz"}
    assert main([str(names.get(argument, argument)) for argument in arguments]) == 1
    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") == 1
    assert {path: path.read_bytes() for path in tmp_path.iterdir()} == before


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["check", "GOOD", "-o", "OUT"], "-o needs --fix"),
        (["check", "GOOD", "--fix"], "--fix takes one clip and -o"),
        (["check", "GOOD", "GOOD", "--fix", "-o", "OUT"], "--fix takes one clip"),
        (["check", "GOOD", "--fix", "-o", "out.yaml"], "must end in .npz"),
        (["join", "GOOD", "-o", "OUT"], "joining needs at least two clips"),
    ],
)
def test_wrong_arguments_have_their_own_status(paths, tmp_path, arguments, message, capsys):
    before = sorted(tmp_path.iterdir())
    names = {"GOOD": paths["good"], "OUT": tmp_path / "out.npz"}
    assert main([str(names.get(argument, argument)) for argument in arguments]) == 2
    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") == 1
    assert sorted(tmp_path.iterdir()) == before
