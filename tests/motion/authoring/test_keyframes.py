"""From keyframe files to clips: names, paths, cache, and motions of other kinds."""

import os
import subprocess
import sys
from importlib.resources import files
from pathlib import Path

import numpy as np
import pytest
from threadpoolctl import threadpool_limits

import tlr_exp.motion.authoring.keyframes as keyframes
from tlr_exp.motion.authoring.balance import GRAVITY
from tlr_exp.motion.authoring.keyframes import build_clip, load_motion, motion_names
from tlr_exp.motion.authoring.script import KeyframeError
from tlr_exp.motion.clip import MotionClip
from tlr_exp.motion.dynamics import centroidal, inverse_dynamics
from tlr_exp.robot.g1 import G1

SHORT = "keyframes: [{time_s: 0}, {time_s: 0.1}]"


@pytest.fixture
def cache(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    return tmp_path / "cache" / "tlr_exp"


@pytest.fixture
def builds(monkeypatch) -> list[str]:
    """The texts that were built instead of read from the cache."""
    texts = []

    def spy(text, robot):
        texts.append(text)
        return build_clip(text, robot)

    monkeypatch.setattr(keyframes, "build_clip", spy)
    return texts


@pytest.fixture
def short(tmp_path):
    path = tmp_path / "short.yaml"
    path.write_text(SHORT)
    return path


def test_authored_motions_are_listed_and_load_by_name(robot, authored, cache):
    assert "stand" in motion_names()
    clip = load_motion("stand", robot)
    np.testing.assert_array_equal(clip.qpos, authored("stand")[0].qpos)


def test_unknown_name_lists_the_names(robot, cache):
    with pytest.raises(ValueError, match=r"no motion 'moonwalk'; the motions are .*gym_motion"):
        load_motion("moonwalk", robot)


def test_clips_load_by_path(robot, swaying_clip, tmp_path):
    path = tmp_path / "clip.npz"
    swaying_clip.save(path)
    np.testing.assert_array_equal(load_motion(path, robot).qpos, swaying_clip.qpos)
    np.testing.assert_array_equal(load_motion(str(path), robot).qpos, swaying_clip.qpos)


@pytest.mark.parametrize("name", ["nowhere.yaml", "nowhere.npz"])
def test_missing_files_are_named(robot, tmp_path, name):
    with pytest.raises(FileNotFoundError, match=name):
        load_motion(tmp_path / name, robot)


def test_mistakes_in_a_file_name_the_file(robot, tmp_path, cache):
    path = tmp_path / "wrong.yaml"
    path.write_text("keyframes: 3")
    with pytest.raises(KeyframeError, match=r"wrong\.yaml: keyframes: expected a list"):
        load_motion(path, robot)


def test_the_second_time_is_read_from_the_cache(robot, short, cache, builds):
    first, second = load_motion(short, robot), load_motion(short, robot)
    assert builds == [SHORT]
    np.testing.assert_array_equal(first.qpos, second.qpos)
    assert [path.suffix for path in cache.iterdir()] == [".npz"]


def test_another_text_is_another_clip(robot, short, cache, builds):
    load_motion(short, robot)
    short.write_text(SHORT.replace("0.1", "0.2"))
    assert load_motion(short, robot).num_frames == 11
    assert len(builds) == 2


def test_another_robot_is_another_clip(robot, short, cache, builds):
    load_motion(short, robot)
    mass = robot.model.body_mass.copy()
    try:
        robot.model.body_mass[5] += 0.5
        load_motion(short, robot)
    finally:
        robot.model.body_mass[:] = mass
    load_motion(short, robot)
    assert len(builds) == 2


@pytest.mark.parametrize("content", [b"", b"PK\x03\x04 torn", b"not a clip"])
def test_a_corrupt_cache_file_is_rebuilt(robot, short, cache, builds, content):
    clip = load_motion(short, robot)
    (path,) = cache.iterdir()
    path.write_bytes(content)
    np.testing.assert_array_equal(load_motion(short, robot).qpos, clip.qpos)
    assert len(builds) == 2
    np.testing.assert_array_equal(MotionClip.load(path, G1).qpos, clip.qpos)


def test_a_cache_that_cannot_be_written_is_done_without(robot, short, tmp_path, monkeypatch):
    # A file in the folder's place refuses even an administrator.
    (tmp_path / "cache").write_text("in the way")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    assert load_motion(short, robot).num_frames == 6


def test_the_cache_is_in_the_home_by_default(robot, short, tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", "")
    monkeypatch.setenv("HOME", str(tmp_path))
    load_motion(short, robot)
    assert len(os.listdir(tmp_path / ".cache" / "tlr_exp")) == 1


def test_same_script_same_bits(robot):
    np.testing.assert_array_equal(build_clip(SHORT, robot).qpos, build_clip(SHORT, robot).qpos)


@pytest.mark.slow
def test_the_threads_of_linear_algebra_change_no_bit(robot):
    text = (files("tlr_exp.motion.clips") / "gym_motion.yaml").read_text(encoding="utf-8")
    clips = []
    for threads in (1, 2):
        with threadpool_limits(threads):
            clips.append(build_clip(text, robot))
    assert np.array_equal(clips[0].qpos, clips[1].qpos)


def test_building_a_clip_does_not_load_jax(short, tmp_path):
    """jax belongs to physics/mjx.py, which must configure it before anything imports it."""
    code = (
        "import sys; from tlr_exp.motion.authoring.keyframes import load_motion\n"
        "from tlr_exp.robot.model import build_robot\n"
        f"assert load_motion({str(short)!r}, build_robot()).num_frames == 6\n"
        "print('mink' in sys.modules, 'jax' in sys.modules)"
    )
    for expected in ("True False", "False False"):  # built, then read from the cache
        run = subprocess.run(
            [sys.executable, "-c", code],
            env=os.environ | {"XDG_CACHE_HOME": str(tmp_path)},
            capture_output=True,
            text=True,
            check=True,
        )
        assert run.stdout.strip() == expected


DOCUMENTATION = (Path(__file__).parents[3] / "docs" / "keyframes.md").read_text(encoding="utf-8")


@pytest.mark.parametrize("number", [0, 1], ids=["wave", "kick"])
def test_the_examples_of_the_documentation_work(robot, number):
    examples = [block.split("```")[0] for block in DOCUMENTATION.split("```yaml\n")[1:]]
    assert len(examples) == 2
    effort = inverse_dynamics(build_clip(examples[number], robot), robot)
    assert effort.unmet_force.max() < 1.0


def test_the_gallery_of_the_documentation_is_the_library():
    for name in motion_names():
        assert f"`{name}`, " in DOCUMENTATION
        assert f"| `{name}` |" in DOCUMENTATION


WALK = """
keyframes:
  - {time_s: 0.0, name: stand, pelvis: {height_m: 0.73}}
  - {time_s: 1.3, right_foot: {x_m: 0.15, swing_s: 0.5}}
  - {time_s: 2.0, left_foot: {x_m: 0.30, swing_s: 0.5}}
  - {time_s: 2.7, right_foot: {x_m: 0.30, swing_s: 0.5}}
  - {time_s: 3.7}
"""
KICK = """
keyframes:
  - {time_s: 0.0, name: stand}
  - {time_s: 0.9, weight_on_right: 0}
  - {time_s: 1.9, right_foot: {x_m: 0.15, z_m: 0.25, pitch_deg: 20, swing_s: 0.9}}
  - {time_s: 2.3, right_foot: {x_m: 0.40, z_m: 0.30, pitch_deg: -20}}
  - {time_s: 2.7, right_foot: {x_m: 0.15, z_m: 0.20, pitch_deg: 20}}
  - {time_s: 3.5, like: stand}
  - {time_s: 4.5}
"""
SQUAT = """
keyframes:
  - {time_s: 0.0, name: stand}
  - {time_s: 1.2, pelvis: {height_m: 0.5, pitch_deg: 20}, hands_m: [0.35, 0.12, 0.15]}
  - {time_s: 2.4, like: stand}
"""
TURN = """
keyframes:
  - {time_s: 0.0}
  - {time_s: 1.4, left_foot: {x_m: -0.05, y_m: 0.12, yaw_deg: 30, swing_s: 0.6}}
  - {time_s: 2.4, right_foot: {x_m: 0.07, y_m: -0.09, yaw_deg: 30, swing_s: 0.6}}
  - {time_s: 2.6, pelvis: {yaw_deg: 30}}
  - {time_s: 3.4}
"""
JUMP = """
keyframes:
  - {time_s: 0.0, name: stand, pelvis: {height_m: 0.75}}
  - {time_s: 0.9, pelvis: {height_m: 0.58, pitch_deg: 30}, arms_deg: {shoulder_pitch: 40}}
  - {time_s: 1.12, pelvis: {height_m: 0.76, pitch_deg: 5}, arms_deg: {shoulder_pitch: -60}}
  - {time_s: 1.24, left_foot: {z_m: 0.08}, right_foot: {z_m: 0.08}}
  - {time_s: 1.36, left_foot: {z_m: 0}, right_foot: {z_m: 0}, pelvis: {height_m: 0.75}}
  - {time_s: 1.6, pelvis: {height_m: 0.58, pitch_deg: 30}}
  - {time_s: 2.5, like: stand}
"""


@pytest.mark.parametrize("text", [WALK, KICK, SQUAT, TURN], ids=["walk", "kick", "squat", "turn"])
def test_other_motions_can_be_written_and_done(robot, text):
    effort = inverse_dynamics(build_clip(text, robot), robot)
    assert effort.unmet_force.max() < 10.0
    assert (np.abs(effort.joint_torque) / robot.effort_limit_nm).max() < 0.7


def test_a_jump_falls_freely(robot):
    """From 1.12 s to 1.36 s; second differences of a parabola are exact."""
    clip = build_clip(JUMP, robot)
    com = centroidal(clip, robot).com[56:69]
    fall = np.diff(com, n=2, axis=0) * clip.fps**2
    np.testing.assert_allclose(fall, np.tile([0, 0, -GRAVITY], (11, 1)), atol=0.01)


def test_a_step_without_time_to_shift_the_weight_is_refused(robot):
    text = "keyframes: [{time_s: 0}, {time_s: 0.6, left_foot: {x_m: 0.1}}, {time_s: 1.5}]"
    with pytest.raises(KeyframeError, match=r"cannot be performed: at .* s the weight is"):
        build_clip(text, robot)


def test_a_stride_beyond_the_legs_is_refused(robot):
    text = """
keyframes:
  - {time_s: 0.0}
  - {time_s: 1.5, pelvis: {height_m: 0.85}}
"""
    with pytest.raises(KeyframeError, match=r"cannot be performed: at .* misses its target"):
        build_clip(text, robot)
