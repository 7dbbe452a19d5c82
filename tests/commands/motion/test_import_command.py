"""tlr-motion: what it writes, says and refuses to overwrite."""

import re
from pathlib import Path

import mujoco
import numpy as np
import pytest

from tlr_exp.commands.motion import main
from tlr_exp.motion.clip import MotionClip, clip_from_qpos
from tlr_exp.motion.clips import motion_names
from tlr_exp.motion.quality.floor import floor_contacts
from tlr_exp.robot.g1 import G1


def csv_of(clip: MotionClip, path: Path) -> Path:
    """Unitree's table; the six wrist joints are zero, after each elbow."""
    joints, wrists = clip.qpos[:, 7:], np.zeros((clip.num_frames, 3))
    parts = [clip.qpos[:, :3], clip.qpos[:, [4, 5, 6, 3]], joints[:, :19], wrists, joints[:, 19:]]
    np.savetxt(path, np.concatenate([*parts, wrists], axis=1), delimiter=",")
    return path


def test_import_writes_a_clip_and_a_report(tmp_path, short_clip, capsys):
    output = tmp_path / "clip.npz"
    table = csv_of(short_clip, tmp_path / "walk.csv")
    assert main(["import", str(table), "--fps", "50", "-o", str(output)]) == 0
    np.testing.assert_allclose(MotionClip.load(output, G1).qpos, short_clip.qpos, atol=1e-9)
    lines = capsys.readouterr().out.splitlines()
    assert lines == [
        f"{table}: lafan1, 41 frames at 50 fps, joints in the order of mujoco",
        "  forward kinematics: not compared, the file has no body positions",
        f"{output}: 41 frames at 50 fps, 0.80 s",
    ]


def test_body_positions_are_compared(tmp_path, short_clip_path, capsys):
    assert main(["import", str(short_clip_path), "-o", str(tmp_path / "clip.npz")]) == 0
    assert "differ by 0.0 mm on average, 0.0 mm at most" in capsys.readouterr().out


def test_another_robot_shows(tmp_path, short_clip, capsys):
    arrays = {key: getattr(short_clip, key).copy() for key in ("qpos", "body_pos_w")}
    arrays["body_pos_w"][:, 26, 2] += 0.1
    path = tmp_path / "other.npz"
    names = {"joint_names": G1.joint_names, "body_names": G1.tracked_bodies}
    np.savez(path, fps=50, **arrays, **names)
    assert main(["import", str(path), "-o", str(tmp_path / "clip.npz")]) == 0
    out = capsys.readouterr().out
    assert "100.0 mm at most (head, frame " in out
    assert "WARNING" in out


def test_clamped_joints_are_reported(tmp_path, short_clip, capsys):
    table = csv_of(short_clip, tmp_path / "walk.csv")
    rows = np.loadtxt(table, delimiter=",")
    rows[3, 7 + 3] = 2.8798 + 0.125
    np.savetxt(table, rows, delimiter=",")
    assert main(["import", str(table), "-o", str(tmp_path / "clip.npz")]) == 0
    out = capsys.readouterr().out
    assert "left_knee_joint: up to 0.125 rad beyond its limit in 1 frames, set to the" in out
    assert main(["import", str(table), "-o", str(tmp_path / "b.npz"), "--clamp", "0.1"]) == 1
    assert not (tmp_path / "b.npz").exists()
    assert "left_knee_joint is 3.005 rad at frame 3" in capsys.readouterr().err


def test_a_table_in_centimetres_with_the_scalar_first(tmp_path, short_clip, capsys):
    table, output = csv_of(short_clip, tmp_path / "walk.csv"), tmp_path / "clip.npz"
    rows = np.loadtxt(table, delimiter=",")
    rows[:, :3] *= 100
    rows[:, 3:7] = rows[:, [6, 3, 4, 5]]
    np.savetxt(table, rows, delimiter=",")
    command = ["import", str(table), "-o", str(output), "--fps", "50"]
    assert main(command) == 1
    assert "give --units cm --quaternion wxyz (or --anyway" in capsys.readouterr().err
    assert not output.exists()
    assert main([*command, "--units", "cm", "--quaternion", "wxyz"]) == 0
    np.testing.assert_allclose(MotionClip.load(output, G1).qpos, short_clip.qpos, atol=1e-9)


def test_what_an_import_changed_is_said(tmp_path, short_clip, capsys):
    table = csv_of(short_clip, tmp_path / "walk.csv")
    rows = np.loadtxt(table, delimiter=",")
    rows[:2, 3:7] *= 0.95
    np.savetxt(table, rows, delimiter=",")
    assert main(["import", str(table), "-o", str(tmp_path / "clip.npz")]) == 0
    out = capsys.readouterr().out
    assert "  a table of this kind does not say its rate: 30 taken, as Unitree's have\n" in out
    assert "another norm than 1 in 2 of 41 frames (0.950 to 1.000): made unit\n" in out
    assert "WARNING" not in out


def test_a_motion_too_short_to_train_on_is_said(tmp_path, short_clip, capsys):
    table = csv_of(short_clip, tmp_path / "walk.csv")
    lines = table.read_text().splitlines()
    for count, warned in ((2, True), (3, False)):
        table.write_text("\n".join(lines[:count]))
        output = tmp_path / f"clip_{count}.npz"
        assert main(["import", str(table), "--fps", "50", "-o", str(output)]) == 0
        out = capsys.readouterr().out
        assert ("WARNING: this motion is too short to train on" in out) == warned
        assert ("at least 3 frames at 50 fps" in out) == warned


def test_nothing_is_overwritten_unasked(tmp_path, short_clip, capsys):
    table, output = csv_of(short_clip, tmp_path / "walk.csv"), tmp_path / "clip.npz"
    output.write_text("mine")
    assert main(["import", str(table), "-o", str(output)]) == 1
    assert "--force" in capsys.readouterr().err
    assert output.read_text() == "mine"
    assert main(["import", str(table), "-o", str(output), "--force"]) == 0
    assert MotionClip.load(output, G1).fps == 50


def test_a_refused_file_leaves_the_old_clip(tmp_path, capsys):
    output, empty = tmp_path / "clip.npz", tmp_path / "empty.pkl"
    output.write_text("mine")
    empty.touch()
    assert main(["import", str(empty), "-o", str(output), "--force"]) == 1
    assert capsys.readouterr().err == f"tlr-motion: {empty}: it is empty\n"
    assert output.read_text() == "mine"
    assert sorted(tmp_path.iterdir()) == [output, empty]


@pytest.mark.parametrize(
    ("output", "message", "status"),
    [("clip.pkl", "must end in .npz", 2), ("absent/clip.npz", "there is no folder", 1)],
)
def test_wrong_output(output, message, status, tmp_path, short_clip_path, capsys):
    assert main(["import", str(short_clip_path), "-o", str(tmp_path / output)]) == status
    assert message in capsys.readouterr().err


def test_input_is_never_the_output(short_clip_path, capsys):
    before = short_clip_path.read_bytes()
    command = ["import", str(short_clip_path), "-o", str(short_clip_path), "--force"]
    assert main(command) == 1
    assert "replace the file it is made from" in capsys.readouterr().err
    assert short_clip_path.read_bytes() == before


def test_info(short_clip_path, capsys):
    """The pelvis stays at 0.78 m and its heading turns by 0.1 rad/s for 0.8 s: 4.6 degrees."""
    assert main(["info", str(short_clip_path)]) == 0
    out = capsys.readouterr().out
    assert "41 frames at 50 fps, 0.80 s" in out
    assert "height 0.780 to 0.780 m" in out
    assert "by at most 5 degrees" in out
    assert "at most 0.000 mm" in out


def number(pattern: str, line: str) -> float:
    """The one number that the pattern finds in a line."""
    (text,) = re.findall(pattern, line)
    return float(text)


def test_info_says_what_a_motion_asks_of_a_robot(tmp_path, robot, capsys):
    """Standing on the floor: each foot carries half of the weight, and the floor can give that."""
    qpos = np.zeros((11, 30))
    qpos[:, 3] = 1.0
    qpos[:, 7:] = robot.default_joint_pos_rad
    qpos[:, 2] -= floor_contacts(clip_from_qpos(qpos, 50.0, robot), robot).lowest.min()
    clip_from_qpos(qpos, 50.0, robot).save(tmp_path / "stand.npz")
    assert main(["info", str(tmp_path / "stand.npz")]) == 0
    torque, floor, unmet = capsys.readouterr().out.splitlines()[-3:]
    weight = mujoco.mj_getTotalmass(robot.model) * 9.81
    left, right, weighs = (float(number) for number in re.findall(r"(\d+) N", floor))
    assert weighs == pytest.approx(weight, abs=0.6)
    assert left + right == pytest.approx(weight, abs=2)
    assert left == pytest.approx(right, rel=0.05)
    assert number(r"([\d.]+) % of its limit", torque) < 60
    assert number(r"at most ([\d.]+) N", unmet) < 1
    qpos[:, 2] += 0.1  # hovering: no floor gives the weight
    clip_from_qpos(qpos, 50.0, robot).save(tmp_path / "hover.npz")
    assert main(["info", str(tmp_path / "hover.npz")]) == 0
    unmet = capsys.readouterr().out.splitlines()[-1]
    assert number(r"at most ([\d.]+) N", unmet) == pytest.approx(weight, rel=0.01)


def test_info_of_what_is_no_clip(tmp_path, capsys):
    assert main(["info", str(tmp_path / "absent.npz")]) == 1
    assert "there is no motion clip" in capsys.readouterr().err


def test_list(capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "60")
    assert main(["list"]) == 0
    lines = capsys.readouterr().out.splitlines()
    named = [line.split()[:3] for line in lines if line[0] != " "]
    assert ["gym_motion", "8.0", "s"] in named
    assert [name for name, *_ in named] == motion_names()
    assert "Seven steps forwards from standing to" in next(li for li in lines if "walk" in li)
    assert max(map(len, lines)) <= 60
