"""What is refused, in one line that names the file and the fault; what is clamped and reported."""

import os
import re

import numpy as np
import pytest
from foreign_files import (
    MUJOCO_ORDER,
    WRITERS,
    asap_motion,
    gmr_motion,
    lafan1,
    locomujoco_arrays,
    npz,
    to_joblib,
    tracking,
)
from wild_files import FORMATS, WILD

from tlr_exp.motion.importers.convert import CLAMP_RAD, import_motion
from tlr_exp.motion.importers.files.containers import MAX_BYTES
from tlr_exp.motion.importers.raw import MotionFileError
from tlr_exp.robot.g1 import G1

KNEE = G1.joint_names.index("left_knee_joint")
KNEE_MAX_RAD = 2.8798


def refusal(path, robot, **arguments) -> str:
    with pytest.raises(MotionFileError) as caught:
        import_motion(path, robot, **arguments)
    message = str(caught.value)
    assert message.startswith(f"{path}: ")
    assert "\n" not in message
    return message


def test_joint_slightly_beyond_its_limit_is_set_to_it(written, robot, short_clip):
    motion = asap_motion(short_clip)
    motion["dof"][5:8, KNEE] = KNEE_MAX_RAD + 0.1
    imported = import_motion(written(to_joblib({"m": motion})), robot)
    (clamp,) = imported.clamps
    assert (clamp.joint, clamp.frames) == ("left_knee_joint", 3)
    assert clamp.excess_rad == pytest.approx(0.1, abs=1e-5)
    np.testing.assert_allclose(imported.clip.qpos[5:8, 7 + KNEE], KNEE_MAX_RAD, atol=1e-9)


def test_joint_far_beyond_its_limit_is_refused_by_name(written, robot, short_clip):
    motion = asap_motion(short_clip)
    motion["dof"][5, KNEE] = KNEE_MAX_RAD + CLAMP_RAD + 0.01
    path = written(to_joblib({"m": motion}))
    assert "left_knee_joint is 3.090 rad at frame 5" in refusal(path, robot)
    with pytest.raises(MotionFileError, match="clamped by nan"):
        import_motion(path, robot, clamp_rad=float("nan"))
    assert import_motion(path, robot, clamp_rad=0.3).clamps[0].joint == "left_knee_joint"


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"dof": np.zeros((41, 22))}, r"dof has shape \[41, 22\]; expected \[any, 23\]"),
        ({"dof": np.zeros((40, 23))}, r"shape \[41, 3\]; expected \[40, 3\]"),
        ({"dof": np.full((41, 23), "x")}, "dof is not an array of numbers"),
        ({"dof": [[0.0] * 23] * 41}, "dof is not an array of numbers"),
        ({"root_trans_offset": np.full((41, 3), np.nan)}, r"root_trans_offset\[0, 0\] is nan"),
        ({"root_trans_offset": np.full((41, 3), 1e300)}, "is 1e"),
        ({"root_trans_offset": np.full((41, 3), 5e4)}, "m from the origin"),
        ({"root_rot": np.full((41, 4), 0.6)}, "quaternion of frame 0 has norm 1.2"),
        ({"root_rot": np.zeros((41, 4))}, "quaternion of frame 0 has norm 0"),
        ({"fps": 0}, "fps is 0"),
        ({"fps": float("nan")}, "fps is nan"),
        ({"fps": 10**400}, "fps is not one number"),
        ({"fps": "30"}, "fps is not one number"),
    ],
)
def test_wrong_content(change, message, written, robot, short_clip):
    path = written(to_joblib({"m": asap_motion(short_clip) | change}))
    assert re.search(message, refusal(path, robot))


def test_missing_content(written, robot, short_clip):
    arrays = tracking(MUJOCO_ORDER, short_clip)
    del arrays["joint_pos"]
    path = written(npz(**arrays))
    assert "its format is not known; it has fps, " in refusal(path, robot)
    assert "it has no joint_pos" in refusal(path, robot, format="beyondmimic")


def test_unknown_joints(written, robot, short_clip):
    arrays = locomujoco_arrays(short_clip)
    arrays["joint_names"] = np.char.replace(arrays["joint_names"], "left_knee", "tail\x1b[31m")
    message = refusal(written(npz(**arrays)), robot)
    assert "unknown joints: tail" in message
    assert "missing joints: left_knee_joint" in message
    assert "\x1b" not in message


def test_number_of_joints(written, robot, short_clip):
    motion = gmr_motion(short_clip) | {"dof_pos": np.zeros((41, 27))}
    assert "27 joints; expected 23 or 29" in refusal(written(to_joblib(motion)), robot)


def test_one_frame(written, robot, short_clip):
    first = lafan1(short_clip).split(b"\n")[0]
    assert "1 frame(s)" in refusal(written(first), robot)


def test_columns_of_a_table(written, robot):
    assert "it has 3 columns; expected 36" in refusal(written(b"1,2,3\n4,5,6\n"), robot)
    assert "no table of numbers" in refusal(written(b"1,2,3\n4,5\n"), robot)


def test_too_long(written, robot, short_clip):
    motion = gmr_motion(short_clip)
    many = {key: np.repeat(motion[key], 50, axis=0) for key in ("root_pos", "root_rot", "dof_pos")}
    path = written(to_joblib(many | {"fps": 1}))
    assert "longer than 30 minutes" in refusal(path, robot)


@pytest.mark.parametrize("data", [b"", b"\x80", b"PK\x03\x04", b"hello\n", b"\x00" * 100])
def test_no_motion_at_all(data, written, robot):
    refusal(written(data), robot)


@pytest.mark.parametrize("name", [*WRITERS, *WILD])
def test_a_file_cut_off(name, motion_files, written, robot):
    """A table cut in its last cell or at a line's end is shorter; every other cut shows."""
    data = motion_files[name]
    for share in (0.1, 0.5, 0.95):
        cut = data[: int(len(data) * share)]
        is_table = FORMATS.get(name, name) in ("lafan1", "bones-seed")
        refusal(written(cut[: cut.rindex(b",")] if is_table else cut), robot)


def test_huge_file_is_refused_before_it_is_read(tmp_path, robot):
    path = tmp_path / "huge.npz"
    with path.open("wb") as file:
        file.truncate(10 << 30)
    assert path.stat().st_size > MAX_BYTES
    assert "it has 10240 MiB; the limit is 256 MiB" in refusal(path, robot)


@pytest.mark.parametrize("compress", [("zlib", 9), ("bz2", 9), ("xz", 6)])
def test_what_unpacks_without_end_is_refused(compress, written, robot, monkeypatch):
    """The limit is lowered, to make the same refusal fast."""
    monkeypatch.setattr("tlr_exp.motion.importers.files.containers.MAX_BYTES", 1 << 20)
    path = written(to_joblib({"m": np.zeros(1 << 20)}, compress=compress))
    assert path.stat().st_size < 1 << 18
    assert "unpacks to more than 1 MiB" in refusal(path, robot)


def test_npz_that_unpacks_to_too_much(tmp_path, robot, monkeypatch):
    monkeypatch.setattr("tlr_exp.motion.importers.files.containers.MAX_BYTES", 1 << 20)
    path = tmp_path / "bomb.npz"
    np.savez_compressed(path, qpos=np.zeros(1 << 20))
    assert "unpacks to more than 1 MiB" in refusal(path, robot)


def test_not_a_plain_file(tmp_path, robot):
    assert "not a plain file" in refusal(tmp_path, robot)
    assert "no such file" in refusal(tmp_path / "absent.pkl", robot)
    os.mkfifo(tmp_path / "pipe")
    assert "not a plain file" in refusal(tmp_path / "pipe", robot)


def test_format_that_the_file_has_not(motion_files, written, robot):
    path = written(motion_files["gmr"])
    assert "it has no joint_names" in refusal(path, robot, format="holosoma")
    assert "unknown format 'bvh'; known are asap" in refusal(path, robot, format="bvh")
