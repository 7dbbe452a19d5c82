"""Every format: a file in its layout gives back the motion that it was made from."""

import json
import pickle
from pathlib import Path

import joblib
import numpy as np
import pytest
from foreign_files import (
    ISAAC_ORDER,
    MUJOCO_ORDER,
    WRITERS,
    asap_motion,
    gmr_motion,
    lafan1,
    link,
    locomujoco_arrays,
    npz,
    to_joblib,
    tracking,
)
from wild_files import FORMATS, WILD, WITHOUT_RATE, amp_arrays, with_others

from tlr_exp.motion.clip import MotionClip, clip_from_qpos, resample
from tlr_exp.motion.importers.convert import import_motion
from tlr_exp.motion.importers.raw import MotionFileError, Options
from tlr_exp.motion.quaternions import angle_between, continuous
from tlr_exp.robot.g1 import G1

REAL = Path(__file__).parents[4] / "shared" / "motions"


@pytest.mark.parametrize("name", [*WRITERS, *WILD])
def test_round_trip(name, motion_files, written, robot, short_clip):
    options = Options(fps=50.0) if name in WITHOUT_RATE else None
    imported = import_motion(written(motion_files[name]), robot, options=options)
    assert imported.format == FORMATS.get(name, name)
    assert imported.clip.fps == 50
    # Several formats hold float32.
    np.testing.assert_allclose(imported.clip.qpos, short_clip.qpos, atol=1e-6)
    np.testing.assert_allclose(imported.clip.body_pos_w, short_clip.body_pos_w, atol=1e-6)
    assert not imported.clamps


BODIES = ["gmr", "mjlab", "beyondmimic", "holosoma", "locomujoco", "tlr"]
BODIES += ["unilab", "hdmi", "amp", "protomotions", "protomotions-library"]


@pytest.mark.parametrize("name", BODIES)
def test_carried_bodies_agree_with_forward_kinematics(name, motion_files, written, robot):
    gap = import_motion(written(motion_files[name]), robot, options=Options(fps=50.0)).gap
    assert gap is not None
    assert gap.max_m < 1e-6


def test_carried_bodies_that_disagree_are_measured(written, robot, short_clip):
    arrays = tracking(MUJOCO_ORDER, short_clip)
    knee = 1 + MUJOCO_ORDER.index("right_knee_joint")
    arrays["body_pos_w"][17, knee, 2] += 0.03
    gap = import_motion(written(npz(**arrays)), robot).gap
    assert gap is not None
    assert gap.max_m == pytest.approx(0.03, abs=1e-6)
    assert (gap.body, gap.frame) == ("right_knee_link", 17)
    # 41 frames, 24 links (the wrists' are not ours): 0.03 m / 984.
    assert gap.mean_m == pytest.approx(0.03 / (41 * 24), rel=1e-3)


@pytest.mark.parametrize(("order", "label"), [(MUJOCO_ORDER, "mujoco"), (ISAAC_ORDER, "isaac")])
def test_joint_order_is_told_from_the_bodies(order, label, written, robot, short_clip):
    imported = import_motion(written(npz(**tracking(order, short_clip))), robot)
    assert imported.raw.joint_order == label


def test_joint_order_must_be_given_where_bodies_do_not_tell(written, robot, short_clip):
    arrays = tracking(ISAAC_ORDER, short_clip)
    arrays["body_pos_w"] = arrays["body_pos_w"][:, :14]
    arrays["body_quat_w"] = arrays["body_quat_w"][:, :14]
    path = written(npz(**arrays))
    with pytest.raises(MotionFileError, match=r"14 bodies.*--joint-order"):
        import_motion(path, robot)
    clip = import_motion(path, robot, options=Options(joint_order="isaac")).clip
    np.testing.assert_allclose(clip.qpos, short_clip.qpos, atol=1e-6)


def test_bodies_that_fit_no_joint_order(written, robot, short_clip):
    arrays = tracking(MUJOCO_ORDER, short_clip)
    arrays["body_pos_w"][:, 1:] = arrays["body_pos_w"][:, :1]
    with pytest.raises(MotionFileError, match="fit neither joint order"):
        import_motion(written(npz(**arrays)), robot)


def test_23_joints_in_isaac_order(written, robot, short_clip):
    order = [name for name in ISAAC_ORDER if name in G1.joint_names]
    imported = import_motion(written(npz(**tracking(order, short_clip))), robot)
    assert imported.raw.joint_order == "isaac"
    np.testing.assert_allclose(imported.clip.qpos, short_clip.qpos, atol=1e-6)


def test_resampling_from_30_to_50_fps(written, robot, short_clip):
    """Frame 5 at 50 fps is at 0.1 s, frame 3 of the file."""
    motion = asap_motion(short_clip) | {"fps": 30}
    clip = import_motion(written(to_joblib({"m": motion})), robot).clip
    # 41 frames last 40/30 s, in which 66 steps of 0.02 s fit.
    assert (clip.num_frames, clip.fps) == (67, 50)
    np.testing.assert_allclose(clip.qpos[5], short_clip.qpos[3], atol=1e-6)
    expected = resample(clip_from_qpos(short_clip.qpos, 30.0, robot), 50.0, robot)
    np.testing.assert_allclose(clip.qpos, expected.qpos, atol=1e-6)


def test_csv_has_30_fps_unless_told(written, robot, short_clip):
    path = written(lafan1(short_clip))
    assert import_motion(path, robot).raw.fps == 30
    assert import_motion(path, robot, options=Options(fps=60.0)).raw.fps == 60


@pytest.mark.parametrize("protocol", range(2, 6))
def test_every_protocol_of_pickle(protocol, written, robot, short_clip):
    motion = gmr_motion(short_clip) | {"fps": np.float64(50)}
    imported = import_motion(written(pickle.dumps(motion, protocol=protocol)), robot)
    np.testing.assert_array_equal(imported.clip.qpos, short_clip.qpos)


@pytest.mark.parametrize(
    "options",
    [
        {"protocol": 3},
        {"compress": ("zlib", 3)},
        {"compress": ("gzip", 3)},
        {"compress": ("xz", 3)},
    ],
)
def test_every_dress_of_joblib(options, written, robot, short_clip):
    data = to_joblib({"m": asap_motion(short_clip)}, **options)
    clip = import_motion(written(data), robot).clip
    np.testing.assert_allclose(clip.qpos, short_clip.qpos, atol=1e-6)


def test_one_of_several_motions(written, robot, short_clip):
    other = asap_motion(short_clip)
    other["root_trans_offset"] = other["root_trans_offset"] + np.float32([1, 1, 0])
    path = written(to_joblib({"one": asap_motion(short_clip), "two": other}))
    with pytest.raises(MotionFileError, match=r"2 motions.*--motion NAME: one, two"):
        import_motion(path, robot)
    clip = import_motion(path, robot, options=Options(motion="two")).clip
    np.testing.assert_allclose(clip.qpos[:, :3], short_clip.qpos[:, :3] + [1, 1, 0], atol=1e-6)
    with pytest.raises(MotionFileError, match=r"no motion 'three'"):
        import_motion(path, robot, options=Options(motion="three"))


def test_one_of_several_trajectories(written, robot, short_clip):
    path = written(npz(**locomujoco_arrays(short_clip) | {"split_points": np.array([0, 20, 41])}))
    with pytest.raises(MotionFileError, match=r"2 trajectories"):
        import_motion(path, robot)
    imported = import_motion(path, robot, options=Options(motion="1"))
    np.testing.assert_allclose(imported.clip.qpos, short_clip.qpos[20:], atol=1e-9)
    assert imported.gap is not None
    assert imported.gap.max_m < 1e-6


def test_trajectory_without_bodies(written, robot, short_clip):
    """Nothing is None, which numpy pickles, or an empty array; names may be pickled too."""
    arrays = locomujoco_arrays(short_clip)
    arrays["joint_names"] = arrays["joint_names"].astype(object)
    for nothing in ({"body_names": None}, {"xpos": np.empty(0)}):
        imported = import_motion(written(npz(**arrays | nothing)), robot)
        np.testing.assert_allclose(imported.clip.qpos, short_clip.qpos, atol=1e-9)
        assert imported.gap is None


def test_named_joints_without_the_root(written, robot, short_clip):
    arrays = tracking(ISAAC_ORDER, short_clip)
    names = ["pelvis", *map(link, ISAAC_ORDER)]
    data = npz(**arrays, joint_names=np.array(ISAAC_ORDER, dtype="S"), body_names=np.array(names))
    imported = import_motion(written(data), robot)
    np.testing.assert_allclose(imported.clip.qpos, short_clip.qpos, atol=1e-6)
    assert imported.gap is not None
    assert imported.gap.max_m < 1e-6


def test_holosoma_root_stored_xyzw_shows_by_its_pelvis(written, robot, short_clip):
    arrays = dict(np.load(written(WRITERS["holosoma"](short_clip)), allow_pickle=False))
    arrays["joint_pos"][:, 3:7] = arrays["joint_pos"][:, [4, 5, 6, 3]]
    clip = import_motion(written(npz(**arrays)), robot).clip
    np.testing.assert_allclose(clip.qpos, short_clip.qpos, atol=1e-6)


@pytest.mark.parametrize("name", ["asap_cr7_level1", "asap_walk_level1", "asap_apt_level2"])
def test_real_clip(name, robot):
    """Against joblib's own reading, and the same pose told a second time as axis and angle."""
    path = REAL / f"{name}.pkl"
    if not path.is_file():
        pytest.skip(f"{path} is not there")
    imported = import_motion(path, robot)
    (motion,) = joblib.load(path).values()
    raw = imported.raw
    assert (imported.format, raw.fps) == ("asap", 30)
    np.testing.assert_array_equal(raw.qpos[:, 7:], motion["dof"])
    np.testing.assert_allclose(raw.qpos[:, 7:], motion["pose_aa"][:, 1:24].sum(-1), atol=1e-5)
    angle = np.linalg.norm(motion["pose_aa"][:, 0], axis=-1, keepdims=True)
    half_sine = np.sin(angle / 2) / np.where(angle == 0, 1, angle)
    told_again = np.concatenate([np.cos(angle / 2), motion["pose_aa"][:, 0] * half_sine], axis=-1)
    assert angle_between(raw.qpos[:, 3:7], told_again).max() < 1e-3
    assert not imported.clamps
    clip: MotionClip = imported.clip
    # Every third frame of the file is every fifth of the clip.
    count = len(raw.qpos[::3])
    np.testing.assert_allclose(clip.qpos[::5][:count, 7:], raw.qpos[::3, 7:], atol=1e-6)
    ours, theirs = clip.qpos[::5][:count, 3:7], continuous(raw.qpos[::3, 3:7])
    assert angle_between(ours, theirs).max() < 1e-6


def test_a_file_without_rate_asks_for_it(motion_files, written, robot):
    with pytest.raises(MotionFileError, match=r"not say its rate \(it has no fps\); give --fps"):
        import_motion(written(motion_files["hdmi"]), robot)


def with_meta(tmp_path, data: bytes, meta: object) -> Path:
    (tmp_path / "meta.json").write_text(json.dumps(meta), encoding="utf-8")
    path = tmp_path / "motion.npz"
    path.write_bytes(data)
    return path


def test_names_and_rate_from_the_meta_json_beside_it(tmp_path, robot, short_clip):
    """HDMI: an object in front, which no order could place, and bodies that are not all ours."""
    arrays = with_others(tracking(ISAAC_ORDER, short_clip), 0, 1)
    del arrays["fps"]
    for key in ("body_pos_w", "body_quat_w"):
        arrays[key] = arrays[key][:, ::-1]
    names = [*["pelvis", *map(link, ISAAC_ORDER)], "largebox"][::-1]
    meta = {"body_names": names, "joint_names": ISAAC_ORDER, "fps": 50.0}
    imported = import_motion(with_meta(tmp_path, npz(**arrays), meta), robot)
    assert imported.format == "holosoma"
    np.testing.assert_allclose(imported.clip.qpos, short_clip.qpos, atol=1e-6)
    assert "joint_names, body_names, fps from the meta.json beside it" in imported.raw.notes


@pytest.mark.parametrize("meta", [{"joint_names": ["a"], "body_names": []}, [1], {}, "x"])
def test_a_meta_json_that_does_not_fit_is_left_aside(meta, tmp_path, robot, short_clip):
    path = with_meta(tmp_path, npz(**tracking(MUJOCO_ORDER, short_clip)), meta)
    imported = import_motion(path, robot)
    assert imported.format == "beyondmimic"
    assert "the meta.json beside it does not fit and is not used" in imported.raw.notes
    (tmp_path / "meta.json").write_bytes(b"\xff{")
    notes = import_motion(path, robot).raw.notes
    assert "the meta.json beside it cannot be read and is not used" in notes


def test_amp_motion_of_another_robot(written, robot, short_clip):
    arrays = amp_arrays(short_clip)
    arrays["dof_names"] = np.array([f"abdomen_{i}" for i in range(29)])
    with pytest.raises(MotionFileError, match=r"not those of the G1; unknown joints: abdomen_0"):
        import_motion(written(npz(**arrays)), robot)


def test_an_object_behind_the_joints(written, robot, short_clip):
    """holosoma puts an object's seven values behind those of the robot."""
    arrays = dict(np.load(written(WRITERS["holosoma"](short_clip)), allow_pickle=False))
    arrays["joint_pos"] = np.hstack([arrays["joint_pos"], np.ones((41, 7))])
    clip = import_motion(written(npz(**arrays)), robot).clip
    np.testing.assert_allclose(clip.qpos, short_clip.qpos, atol=1e-6)
