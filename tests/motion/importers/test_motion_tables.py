"""Tables as people write them: separators, comments, names in any order, times, other robots."""

import io

import numpy as np
import pytest
from foreign_files import MUJOCO_ORDER, npz
from wild_files import NAMED, bones_seed, lafan1_rows, text

from tlr_exp.motion.importers.convert import import_motion
from tlr_exp.motion.importers.raw import MotionFileError, Options
from tlr_exp.motion.importers.readings.columns import joint_of, plain, understand
from tlr_exp.robot.g1 import G1

ROOT = ["x", "y", "z", "qx", "qy", "qz", "qw"]


def german(rows: np.ndarray) -> bytes:
    return text(rows, ";").replace(b".", b",")


def bare_array(rows: np.ndarray) -> bytes:
    file = io.BytesIO()
    np.save(file, rows)
    return file.getvalue()


DRESSES = {
    "semicolons": lambda rows: text(rows, ";"),
    "semicolons, decimal commas": german,
    "tabs": lambda rows: text(rows, "\t"),
    "spaces": lambda rows: text(rows, "  "),
    "comments": lambda rows: b"# made by hand\n#\n" + text(rows) + b"\n# the end\n",
    "windows": lambda rows: b"\xef\xbb\xbf" + text(rows).replace(b"\n", b"\r\n"),
    "utf-16": lambda rows: text(rows).decode().encode("utf-16"),
    "comma at the end": lambda rows: text(rows).replace(b"\n", b",\n"),
    "names without joints": lambda rows: text(rows, names=[f"c{i}" for i in range(36)]),
    "npy": bare_array,
    "npy, single precision": lambda rows: bare_array(rows.astype(np.float32)),
}


@pytest.mark.parametrize("name", DRESSES)
def test_every_dress_of_a_table(name, written, robot, short_clip):
    path = written(DRESSES[name](lafan1_rows(short_clip)))
    imported = import_motion(path, robot, options=Options(fps=50.0))
    assert imported.format == "lafan1"
    np.testing.assert_allclose(imported.clip.qpos, short_clip.qpos, atol=1e-6)


def names_of(style: str) -> list[str]:
    joints = [name.removesuffix("_joint") for name in MUJOCO_ORDER]
    return {
        "plain": ROOT + MUJOCO_ORDER,
        "without joint": [f"root_{n}" for n in ROOT] + joints,
        "spoken": [f"Root Pos {a}" for a in "XYZ"]
        + [f"root_quat_{a}" for a in "xyzw"]
        + [f"{j} position".replace("_", " ") for j in joints],
        "dotted": [f"base.pos.{a}" for a in "xyz"]
        + [f"base.rot.{a}" for a in "xyzw"]
        + [f"joint_pos.{j}_joint" for j in joints],
        "camel": [f"RootTranslation{a}" for a in "XYZ"]
        + [f"RootRotation{a}" for a in "XYZW"]
        + ["".join(part.title() for part in j.split("_")) for j in joints],
    }[style]


@pytest.mark.parametrize("style", ["plain", "without joint", "spoken", "dotted", "camel"])
def test_names_in_any_order(style, written, robot, short_clip):
    shuffle = np.random.default_rng(0).permutation(36)
    names = names_of(style)
    data = text(lafan1_rows(short_clip)[:, shuffle], names=[names[i] for i in shuffle])
    imported = import_motion(written(data), robot, options=Options(fps=50.0))
    assert imported.raw.joint_order == ""
    np.testing.assert_allclose(imported.clip.qpos, short_clip.qpos, atol=1e-9)


def test_names_in_a_comment(written, robot, short_clip):
    file = io.BytesIO()
    rows = lafan1_rows(short_clip)[:, ::-1]
    np.savetxt(file, rows, delimiter=",", header=",".join((ROOT + MUJOCO_ORDER)[::-1]))
    clip = import_motion(written(file.getvalue()), robot, options=Options(fps=50.0)).clip
    np.testing.assert_allclose(clip.qpos, short_clip.qpos, atol=1e-9)


def test_columns_that_say_nothing_of_a_pose_are_named(written, robot, short_clip):
    rows = np.column_stack([lafan1_rows(short_clip), np.ones((41, 2))])
    names = [*ROOT, *MUJOCO_ORDER, "left_knee_joint_vel", "mood"]
    raw = import_motion(written(text(rows, names=names)), robot, options=Options(fps=50.0)).raw
    assert "columns that are not used: left_knee_joint_vel, mood" in raw.notes


@pytest.mark.parametrize(
    ("left_out", "message"),
    [
        ("left_knee_joint", "missing joints: left_knee_joint"),
        ("z", r"not the position of the root \(x y z\); found: x, y"),
        ("qw", r"not the orientation of the root"),
    ],
)
def test_a_named_column_that_is_missing(left_out, message, written, robot, short_clip):
    names = ROOT + MUJOCO_ORDER
    kept = [i for i, name in enumerate(names) if name != left_out]
    data = text(lafan1_rows(short_clip)[:, kept], names=[names[i] for i in kept])
    with pytest.raises(MotionFileError, match=message):
        import_motion(written(data), robot)


@pytest.mark.parametrize("named", [True, False])
def test_the_rate_comes_from_the_times(named, written, robot, short_clip):
    """Rounded to milliseconds, 1/60 s is 16 or 17 ms."""
    times = (np.arange(41) / 60).round(3)
    rows = np.column_stack([times, lafan1_rows(short_clip)])
    data = text(rows, names=["time", *ROOT, *MUJOCO_ORDER] if named else ())
    raw = import_motion(written(data), robot).raw
    assert raw.fps == 60
    assert not any("rate" in note for note in raw.notes)
    assert import_motion(written(data), robot, options=Options(fps=50.0)).raw.fps == 50


def test_numbers_of_frames_say_no_rate(written, robot, short_clip):
    rows = np.column_stack([np.arange(41), lafan1_rows(short_clip)])
    raw = import_motion(written(text(rows)), robot).raw
    assert raw.fps == 30
    assert any("does not say its rate: 30 taken" in note for note in raw.notes)


@pytest.mark.parametrize(
    ("times", "message"),
    [
        (np.arange(41) * 20.0, "rises by 20 a row, which is neither seconds nor one frame"),
        (np.r_[np.arange(20), np.arange(21)] / 50, "does not rise evenly"),
        (np.zeros(41), "does not rise evenly"),
    ],
)
def test_times_that_are_none(times, message, written, robot, short_clip):
    rows = np.column_stack([times, lafan1_rows(short_clip)])
    with pytest.raises(MotionFileError, match=message):
        import_motion(written(text(rows)), robot)


@pytest.mark.parametrize(
    ("width", "message"),
    [
        (26, r"Unitree's H1 \(19 joints\), not of the G1"),
        (27, r"Unitree's H1 \(19 joints\), not of the G1"),
        (34, r"Unitree's H1-2 \(27 joints\), not of the G1"),
        (29, "joints alone"),
        (40, "it has 40 columns; expected 36"),
    ],
)
def test_tables_of_other_widths(width, message, written, robot):
    with pytest.raises(MotionFileError, match=message):
        import_motion(written(text(np.zeros((5, width)))), robot)


def test_bones_seed_asks_for_its_rate(written, robot, short_clip):
    with pytest.raises(MotionFileError, match=r"give --fps \(BONES-SEED's own tables have 120"):
        import_motion(written(bones_seed(short_clip)), robot)


def test_bones_seed_in_metres_and_radians(written, robot, short_clip):
    """The names are the same; the numbers tell, and the options take them."""
    rows = np.loadtxt(io.BytesIO(bones_seed(short_clip)), delimiter=",", skiprows=1)
    rows[:, 1:4] /= 100
    rows[:, 4:] = np.radians(rows[:, 4:])
    path = written(text(rows, names=[*NAMED, *(f"{joint}_dof" for joint in MUJOCO_ORDER)]))
    with pytest.raises(MotionFileError, match="--units m"):
        import_motion(path, robot, options=Options(fps=50.0))
    options = Options(fps=50.0, units="m", angles="rad")
    clip = import_motion(path, robot, options=options).clip
    np.testing.assert_allclose(clip.qpos, short_clip.qpos, atol=1e-9)


def test_a_row_that_is_wrong_is_named(written, robot, short_clip):
    lines = text(lafan1_rows(short_clip)).split(b"\n")
    lines[6] = lines[6].replace(b",", b",nought ", 1)
    with pytest.raises(MotionFileError, match=r"row 7 has 'nought"):
        import_motion(written(b"\n".join(lines)), robot)
    lines[6] = b"1,2"
    with pytest.raises(MotionFileError, match="row 7 has 2 columns, the first has 36"):
        import_motion(written(b"\n".join(lines)), robot)
    with pytest.raises(MotionFileError, match="names 36 columns, the second has 3 numbers"):
        import_motion(written(",".join(ROOT + MUJOCO_ORDER).encode() + b"\n1,2,3\n"), robot)


@pytest.mark.parametrize(
    ("given", "joint"),
    [
        ("LeftHipPitch", "left_hip_pitch_joint"),
        ("kLeftHipPitch", "left_hip_pitch_joint"),
        ("left_hip_pitch_joint_dof", "left_hip_pitch_joint"),
        ("dof_pos/right knee", "right_knee_joint"),
        ("L_elbow", "left_elbow_joint"),
        ("waist_yaw_joint_pos_rad", "waist_yaw_joint"),
        ("left_knee_joint_vel", None),
        ("torso_joint", "torso_joint"),
        ("torso", None),
        ("x", None),
    ],
)
def test_names_of_joints(given, joint):
    assert joint_of(plain(given), G1) == joint


def test_names_of_other_columns():
    columns = understand(("Time (s)", "Frame", "pelvis_x", "q_w", "root.quat.x", "yaw", "foo"), G1)
    assert understand(("rot_x", "rot_y", "rot_z"), G1).euler == {"x": 0, "y": 1, "z": 2}
    assert (columns.time, columns.frame, columns.position) == (0, 1, {"x": 2})
    assert (columns.quaternion, columns.euler) == ({"w": 3, "x": 4}, {"z": 5})
    assert columns.unknown == ["foo"]


def test_h1_with_names(written, robot):
    names = [*ROOT, "left_hip_yaw_joint", "torso_joint_dof", "left_knee_joint"]
    with pytest.raises(MotionFileError, match="missing joints"):
        import_motion(written(text(np.ones((5, 10)), names=names)), robot)


def test_a_table_inside_an_npz_is_still_not_known(written, robot):
    with pytest.raises(MotionFileError, match="its format is not known; it has table"):
        import_motion(written(npz(table=np.zeros((5, 36)))), robot)
