"""A file read by the wrong conventions is refused, with the option that reads it rightly."""

import numpy as np
import pytest
from foreign_files import MUJOCO_ORDER, npz, tracking
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from wild_files import lafan1_rows, text

from tlr_exp.motion.clip import MotionClip, clip_from_qpos
from tlr_exp.motion.importers.convert import import_motion
from tlr_exp.motion.importers.raw import Conventions, MotionFileError, Options, RawMotion, Recorded
from tlr_exp.motion.importers.readings.conventions import interpret
from tlr_exp.motion.importers.readings.joints import in_order
from tlr_exp.motion.importers.readings.plausible import check_plausible
from tlr_exp.motion.importers.readings.stance import StanceMeter
from tlr_exp.robot.g1 import G1

# From the world of a robot (z up) to one whose y axis points up.
TO_Y_UP = Rotation.from_euler("x", -90, degrees=True)


def turned(clip: MotionClip, degrees: float, robot) -> MotionClip:
    """The same motion, begun in another direction."""
    turn, qpos = Rotation.from_euler("z", degrees, degrees=True), clip.qpos.copy()
    qpos[:, :3] = turn.apply(qpos[:, :3])
    qpos[:, 3:7] = (turn * Rotation.from_quat(qpos[:, [4, 5, 6, 3]])).as_quat()[:, [3, 0, 1, 2]]
    return clip_from_qpos(qpos, clip.fps, robot)


def centimetres(rows: np.ndarray) -> np.ndarray:
    return rows * np.r_[[100.0] * 3, [1.0] * (rows.shape[1] - 3)]


def millimetres(rows: np.ndarray) -> np.ndarray:
    return rows * np.r_[[1000.0] * 3, [1.0] * (rows.shape[1] - 3)]


def scalar_first(rows: np.ndarray) -> np.ndarray:
    return np.hstack([rows[:, :3], rows[:, [6, 3, 4, 5]], rows[:, 7:]])


def degrees(rows: np.ndarray) -> np.ndarray:
    return np.hstack([rows[:, :7], np.degrees(rows[:, 7:])])


def y_up(rows: np.ndarray) -> np.ndarray:
    """The world turned."""
    quats = (TO_Y_UP * Rotation.from_quat(rows[:, 3:7])).as_quat()
    return np.hstack([TO_Y_UP.apply(rows[:, :3]), quats, rows[:, 7:]])


def y_up_renamed(rows: np.ndarray) -> np.ndarray:
    """The axes of the pelvis renamed as those of the world."""
    quats = (TO_Y_UP * Rotation.from_quat(rows[:, 3:7]) * TO_Y_UP.inv()).as_quat()
    return np.hstack([TO_Y_UP.apply(rows[:, :3]), quats, rows[:, 7:]])


def y_up_positions(rows: np.ndarray) -> np.ndarray:
    """Only the positions turned."""
    return np.hstack([TO_Y_UP.apply(rows[:, :3]), rows[:, 3:]])


def isaac(rows: np.ndarray) -> np.ndarray:
    names = [MUJOCO_ORDER.index(name) for name in in_order(29, "isaac", G1)]
    return np.hstack([rows[:, :7], rows[:, 7:][:, names]])


WRITTEN = {
    "--units cm": (centimetres, {"units": "cm"}),
    "--units mm": (millimetres, {"units": "mm"}),
    "--quaternion wxyz": (scalar_first, {"quaternion": "wxyz"}),
    "--up y": (y_up, {"up": "y"}),
    "--up y (renamed)": (y_up_renamed, {"up": "y"}),
    "--up y (positions)": (y_up_positions, {"up": "y"}),
    "--angles deg": (degrees, {"angles": "deg"}),
    "--joint-order isaac": (isaac, {"joint_order": "isaac"}),
    "--units cm --quaternion wxyz": (
        lambda rows: centimetres(scalar_first(rows)),
        {"units": "cm", "quaternion": "wxyz"},
    ),
    "--units cm --up y": (lambda rows: centimetres(y_up(rows)), {"units": "cm", "up": "y"}),
}


@pytest.mark.parametrize("heading", [0, 100, 170])
@pytest.mark.parametrize("name", WRITTEN)
def test_a_wrong_reading_is_named_with_its_option(name, heading, written, robot, short_clip):
    write, says = WRITTEN[name]
    clip = turned(short_clip, heading, robot)
    path = written(text(write(lafan1_rows(clip))))
    with pytest.raises(MotionFileError) as caught:
        import_motion(path, robot, options=Options(fps=50.0))
    assert f"give {name.split(' (')[0]} (or --anyway" in str(caught.value)
    read = import_motion(path, robot, options=Options(fps=50.0, **says)).clip
    np.testing.assert_allclose(read.qpos, clip.qpos, atol=1e-9)


def test_anyway_takes_what_looks_wrong(written, robot, short_clip):
    path = written(text(centimetres(lafan1_rows(short_clip))))
    raw = import_motion(path, robot, options=Options(anyway=True)).raw
    np.testing.assert_allclose(raw.qpos[:, :3], short_clip.qpos[:, :3] * 100, atol=1e-9)


def test_what_no_reading_makes_stand(written, robot, short_clip):
    """Heights counted from the pelvis at its start: 0.78 m too low."""
    rows = lafan1_rows(short_clip)
    rows[:, 2] -= rows[0, 2]
    path = written(text(rows))
    with pytest.raises(MotionFileError, match=r"m under the floor in most.*--anyway.*check --fix"):
        import_motion(path, robot)
    assert import_motion(path, robot, options=Options(anyway=True)).clip.num_frames > 2


def test_a_rate_that_cannot_be(written, robot, short_clip):
    """2 cm/s at 50 Hz are 0.4 mm a frame; 30 m at a time are seen at any rate."""
    rows = lafan1_rows(short_clip)
    rows[:, 0] = np.arange(len(rows)) * 0.5
    with pytest.raises(MotionFileError, match=r"moves at 15 m/s.*--fps RATE"):
        import_motion(written(text(rows)), robot)
    assert import_motion(written(text(rows)), robot, options=Options(fps=10.0)).raw.fps == 10


def test_root_quaternion_that_the_bodies_contradict(written, robot, short_clip):
    """Facing backwards, a wrong order of the four still stands; the other bodies tell."""
    clip = turned(short_clip, 180, robot)
    arrays = tracking(MUJOCO_ORDER, clip)
    arrays["body_quat_w"] = np.roll(arrays["body_quat_w"], -1, axis=-1)
    path = written(npz(**arrays))
    with pytest.raises(MotionFileError, match="give --quaternion xyzw"):
        import_motion(path, robot)
    read = import_motion(path, robot, options=Options(quaternion="xyzw")).clip
    np.testing.assert_allclose(read.qpos[:, 7:], clip.qpos[:, 7:], atol=1e-6)


def lying(robot) -> np.ndarray:
    """[30, 30]: on the back, the legs moving."""
    time = np.arange(30) / 30
    qpos = np.zeros((30, 30))
    qpos[:, 2], qpos[:, 3], qpos[:, 5] = 0.12, np.sqrt(0.5), -np.sqrt(0.5)
    qpos[:, 7:] = 0.3 * np.sin(3 * time)[:, None] * (robot.default_joint_pos_rad != 0)
    return qpos


def test_lying_on_the_floor_is_a_motion(robot):
    recorded = of_qpos(lying(robot), 30.0)
    raw = interpret(recorded, recorded.conventions, robot.spec)
    stance = StanceMeter(robot).measure(raw)
    assert not stance.stands
    assert stance.fault == ""
    check_plausible(recorded, raw, robot, Options(), 0.2)


def of_qpos(qpos: np.ndarray, fps: float) -> Recorded:
    conventions = Conventions(quaternion="wxyz", joint_order="mujoco")
    return Recorded(fps, qpos[:, :3], qpos[:, 3:7], qpos[:, 7:], None, conventions)


@pytest.mark.parametrize("name", ["gym_motion", "jump", "squat", "run"])
@settings(max_examples=8, derandomize=True)
@given(heading=st.floats(-180, 180))
def test_motions_as_they_are_pass(name, heading, robot, authored):
    clip = turned(authored(name)[0], heading, robot)
    recorded = of_qpos(clip.qpos, clip.fps)
    check_plausible(
        recorded, interpret(recorded, recorded.conventions, robot.spec), robot, Options(), 0.2
    )


def test_what_is_measured(robot):
    """Upright with straight legs, the soles parallel to the floor and 5 cm over it."""
    qpos = np.zeros((11, 30))
    qpos[:, 3] = 1.0
    qpos[:, 0] = np.arange(11) * 0.02
    lowest = StanceMeter(robot).measure(RawMotion(50.0, qpos)).lowest_m
    qpos[:, 2] = 0.05 - lowest
    stance = StanceMeter(robot).measure(RawMotion(50.0, qpos))
    assert stance.lowest_m == pytest.approx(0.05)
    assert (stance.up, stance.tilt_rad) == (pytest.approx(1.0), pytest.approx(0.0, abs=1e-6))
    assert stance.speed_m_s == pytest.approx(1.0)
    assert stance.stands
    # A foot rolled by 0.2 rad on both sides is 0.2 rad off the floor.
    for joint in ("left_ankle_roll_joint", "right_ankle_roll_joint"):
        qpos[:, 7 + robot_joint(joint)] = 0.2
    assert StanceMeter(robot).measure(RawMotion(50.0, qpos)).tilt_rad == pytest.approx(0.2)


def robot_joint(name: str) -> int:
    return [n for n in MUJOCO_ORDER if "wrist" not in n].index(name)


@pytest.mark.parametrize("norm", [0.94, 0.99, 1.05])
def test_blended_quaternions_are_made_unit_and_counted(norm, written, robot, short_clip):
    rows = lafan1_rows(short_clip)
    rows[3:8, 3:7] *= norm
    imported = import_motion(written(text(rows)), robot, options=Options(fps=50.0))
    np.testing.assert_allclose(imported.clip.qpos, short_clip.qpos, atol=1e-9)
    (note,) = [n for n in imported.raw.notes if "norm" in n]
    assert f"in 5 of 41 frames ({min(norm, 1):.3f} to {max(norm, 1):.3f})" in note


@pytest.mark.parametrize("norm", [0.89, 1.11])
def test_what_is_no_orientation(norm, written, robot, short_clip):
    rows = lafan1_rows(short_clip)
    rows[5, 3:7] *= norm
    with pytest.raises(MotionFileError, match=f"frame 5 has norm {norm}; expected 1"):
        import_motion(written(text(rows)), robot)
