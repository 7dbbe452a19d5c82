"""MotionClip: what it refuses, what it derives, and what survives the disk."""

import dataclasses

import mujoco
import numpy as np
import pytest

from tlr_exp.motion.checks import ARRAYS
from tlr_exp.motion.clip import (
    MotionClip,
    check_consistency,
    clip_from_qpos,
    kinematics_error,
)
from tlr_exp.motion.quaternions import angle_between, continuous
from tlr_exp.robot.g1 import G1


def test_frames_and_duration(swaying_clip):
    assert swaying_clip.num_frames == 101
    assert swaying_clip.duration_s == pytest.approx(2.0)


def test_constant_twist_gives_constant_velocity(robot):
    """1 rad/s about the vertical and 0.3 m/s ahead, the pelvis tilted a quarter turn about x."""
    time = np.arange(20) / 50
    qpos = np.zeros((20, 30))
    qpos[:, 0], qpos[:, 2] = 0.3 * time, 0.8
    half = np.sqrt(0.5)
    spin = np.stack([np.cos(time / 2), np.sin(time / 2)])
    # (cos, 0, 0, sin) * (half, half, 0, 0): the turn about z after the tilt about x.
    qpos[:, 3:7] = np.stack([spin[0], spin[0], spin[1], spin[1]], axis=1) * half
    clip = clip_from_qpos(qpos, 50.0, robot)
    np.testing.assert_allclose(clip.qvel[:, :3], [[0.3, 0, 0]] * 20, atol=1e-9)
    # World z is the tilted pelvis's y axis.
    np.testing.assert_allclose(clip.qvel[:, 3:6], [[0, 1, 0]] * 20, atol=1e-9)
    np.testing.assert_allclose(clip.body_ang_vel_w[:, 0], [[0, 0, 1]] * 20, atol=1e-9)
    np.testing.assert_allclose(clip.qvel[:, 6:], 0, atol=1e-9)


def test_end_velocities_are_second_order(robot):
    """A joint that accelerates uniformly: the one-sided differences are exact too."""
    qpos = np.zeros((6, 30))
    qpos[:, 2], qpos[:, 3] = 0.8, 1.0
    time = np.arange(6) / 10
    qpos[:, 7] = 0.5 * time**2
    clip = clip_from_qpos(qpos, 10.0, robot)
    np.testing.assert_allclose(clip.qvel[:, 6], time, atol=1e-12)


def test_two_frames_suffice(robot, swaying_qpos):
    clip = clip_from_qpos(swaying_qpos[:2], 50.0, robot)
    np.testing.assert_allclose(
        clip.qvel[:, 6:], np.tile((swaying_qpos[1, 7:] - swaying_qpos[0, 7:]) * 50, (2, 1))
    )


def test_body_twists_are_those_of_mujoco(robot, swaying_clip):
    model, data = robot.model, mujoco.MjData(robot.model)
    for t in (0, 37, 100):
        data.qpos[:], data.qvel[:] = swaying_clip.qpos[t], swaying_clip.qvel[t]
        mujoco.mj_forward(model, data)
        for i, name in enumerate(G1.tracked_bodies):
            twist = np.zeros(6)
            mujoco.mj_objectVelocity(
                model, data, mujoco.mjtObj.mjOBJ_XBODY, model.body(name).id, twist, 0
            )
            np.testing.assert_allclose(swaying_clip.body_ang_vel_w[t, i], twist[:3], atol=1e-12)
            np.testing.assert_allclose(swaying_clip.body_lin_vel_w[t, i], twist[3:], atol=1e-12)
            np.testing.assert_allclose(swaying_clip.body_pos_w[t, i], data.body(name).xpos)


def test_body_velocities_are_the_rate_of_positions(swaying_clip):
    rate = (swaying_clip.body_pos_w[2:] - swaying_clip.body_pos_w[:-2]) * 25
    np.testing.assert_allclose(swaying_clip.body_lin_vel_w[1:-1], rate, atol=2e-3)


def test_a_step_of_mujoco_agrees_with_the_velocity_convention(robot, swaying_clip):
    qpos = swaying_clip.qpos[50].copy()
    mujoco.mj_integratePos(robot.model, qpos, swaying_clip.qvel[50], 1 / 50)
    np.testing.assert_allclose(qpos, swaying_clip.qpos[51], atol=2e-3)
    assert angle_between(qpos[3:7], swaying_clip.qpos[51, 3:7]) < 1e-3


def test_save_and_load_keep_every_bit(swaying_clip, tmp_path):
    path = tmp_path / "clip.npz"
    swaying_clip.save(path)
    loaded = MotionClip.load(path, G1)
    for key in ARRAYS:
        np.testing.assert_array_equal(getattr(loaded, key), getattr(swaying_clip, key))
    assert (loaded.fps, loaded.spec) == (50.0, G1)
    with np.load(path) as file:
        assert tuple(file["joint_names"]) == G1.joint_names
        assert tuple(file["body_names"]) == G1.tracked_bodies
    assert [p.name for p in tmp_path.iterdir()] == ["clip.npz"]


def test_failed_save_leaves_the_old_file(swaying_clip, tmp_path, monkeypatch):
    path = tmp_path / "clip.npz"
    path.write_bytes(b"old")

    def full_disk(file, **arrays):
        file.write(b"half")
        raise OSError("no space left on device")

    monkeypatch.setattr(np, "savez_compressed", full_disk)
    with pytest.raises(OSError, match="no space"):
        swaying_clip.save(path)
    assert path.read_bytes() == b"old"
    assert [p.name for p in tmp_path.iterdir()] == ["clip.npz"]


def test_arrays_are_read_only_copies(robot, swaying_qpos):
    clip = clip_from_qpos(swaying_qpos, 50.0, robot)
    with pytest.raises(ValueError, match="read-only"):
        clip.qpos[0, 0] = 1.0
    assert swaying_qpos.flags.writeable


@pytest.mark.parametrize("content", [b"", b"not a zip file", b"PK\x03\x04 cut off"])
def test_unreadable_file_is_named(tmp_path, content):
    path = tmp_path / "broken.npz"
    path.write_bytes(content)
    with pytest.raises(ValueError, match=r"broken\.npz"):
        MotionClip.load(path, G1)


def test_missing_file_is_named(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"nowhere\.npz"):
        MotionClip.load(tmp_path / "nowhere.npz", G1)


def test_missing_key_is_named(tmp_path):
    path = tmp_path / "part.npz"
    np.savez(path, qpos=np.zeros((3, 30)), fps=50.0)
    with pytest.raises(ValueError, match=r"lacks qvel, body_pos_w.*has \['qpos', 'fps'\]"):
        MotionClip.load(path, G1)


def test_pickled_arrays_are_refused(tmp_path, swaying_clip):
    path = tmp_path / "pickled.npz"
    content = {key: getattr(swaying_clip, key) for key in ARRAYS}
    np.savez(
        path,
        **content,
        fps=50.0,
        joint_names=np.array(G1.joint_names, dtype=object),
        body_names=np.array(G1.tracked_bodies),
    )
    with pytest.raises(ValueError, match="allow_pickle"):
        MotionClip.load(path, G1)


def _bad(clip: MotionClip, key: str, index, value) -> dict:
    array = getattr(clip, key).copy()
    array[index] = value
    return {key: array}


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda c: {"fps": 0.0}, "fps is 0.0"),
        (lambda c: {"fps": float("nan")}, "fps is nan"),
        (lambda c: {"qpos": c.qpos[:, :29]}, r"qpos is \[101, 29\]; expected \[T, 30\]"),
        (lambda c: {"qvel": c.qvel[:50]}, r"qvel is \[50, 29\].*T = 101"),
        (lambda c: {k: getattr(c, k)[:1] for k in ARRAYS}, r"1 frame\(s\)"),
        (lambda c: _bad(c, "qvel", (4, 7), np.nan), r"qvel\[4, 7\] is nan"),
        (lambda c: _bad(c, "body_pos_w", (9, 3, 1), np.inf), r"body_pos_w\[9, 3, 1\] is inf"),
        (lambda c: _bad(c, "qpos", (5, slice(3, 7)), 0.6), r"norm 1.2 at \[5\]"),
        (lambda c: _bad(c, "body_quat_w", (5, 2), 0.0), r"body_quat_w.*norm 0 at \[5, 2\]"),
        (lambda c: _bad(c, "qpos", (8, 10), 3.1), "left_knee_joint is 3.100 rad at frame 8"),
    ],
)
def test_invalid_clips_are_refused(swaying_clip, change, message):
    with pytest.raises(ValueError, match=message):
        dataclasses.replace(swaying_clip, **change(swaying_clip))


@pytest.mark.parametrize(
    ("names", "message"),
    [
        ({"joint_names": G1.joint_names[:-1]}, "missing: right_elbow_joint; the clip has"),
        ({"joint_names": (*G1.joint_names, "tail")}, "unknown: tail"),
        ({"joint_names": G1.joint_names[::-1]}, "order"),
        ({"body_names": ("hips", *G1.tracked_bodies[1:])}, "missing: pelvis; unknown: hips"),
    ],
)
def test_a_file_of_other_joints_or_bodies_is_refused(swaying_clip, tmp_path, names, message):
    path = tmp_path / "other.npz"
    swaying_clip.save(path)
    with np.load(path) as file:
        content = dict(file)
    np.savez(path, **content | names)
    with pytest.raises(ValueError, match=rf"other\.npz.*the 23-joint G1; .*{message}"):
        MotionClip.load(path, G1)


@pytest.mark.parametrize(
    ("qpos", "fps", "message"),
    [
        (np.zeros((5, 29)), 50.0, "30"),
        (np.zeros((1, 30)), 50.0, ">= 2"),
        (np.full((5, 30), np.nan), 50.0, "nan"),
        (np.zeros((5, 30)), 50.0, "norm 0"),
        (np.ones((5, 30)), -1.0, "fps"),
    ],
)
def test_invalid_qpos_is_refused_before_mujoco_sees_it(robot, qpos, fps, message):
    with pytest.raises(ValueError, match=message):
        clip_from_qpos(qpos, fps, robot)


def test_quaternion_signs_do_not_jump(robot, swaying_qpos, swaying_clip):
    flipped = swaying_qpos.copy()
    flipped[40:60, 3:7] *= -1
    clip = clip_from_qpos(flipped, 50.0, robot)
    np.testing.assert_allclose(clip.qpos, swaying_clip.qpos, atol=1e-12)
    np.testing.assert_allclose(clip.qvel, swaying_clip.qvel, atol=1e-9)
    assert (np.sum(clip.body_quat_w[1:] * clip.body_quat_w[:-1], axis=-1) > 0).all()


def test_kinematics_error_sees_a_foreign_body(robot, swaying_clip):
    assert max(kinematics_error(swaying_clip, robot)) < 1e-9
    moved = swaying_clip.body_pos_w.copy()
    moved[10, 4, 2] += 0.03
    clip = dataclasses.replace(swaying_clip, body_pos_w=moved)
    assert kinematics_error(clip, robot)[0] == pytest.approx(0.03)
    turned = swaying_clip.body_quat_w.copy()
    turned[10, 4] = turned[10, 5]
    angle = angle_between(swaying_clip.body_quat_w[10, 4], swaying_clip.body_quat_w[10, 5])
    clip = dataclasses.replace(swaying_clip, body_quat_w=turned)
    assert kinematics_error(clip, robot)[1] == pytest.approx(float(angle))


def test_continuous_undoes_any_flips():
    rng = np.random.default_rng(0)
    angle = np.linspace(0, 7, 60)
    quats = np.stack([np.cos(angle / 2), np.sin(angle / 2), 0 * angle, 0 * angle], axis=1)
    signs = rng.choice([-1.0, 1.0], size=60)
    signs[0] = 1.0
    np.testing.assert_allclose(continuous(quats * signs[:, None]), quats)


def test_a_clip_whose_bodies_or_velocities_are_not_its_own_is_refused(robot, short_clip):
    check_consistency(short_clip, robot, "short.npz")
    moved = dataclasses.replace(short_clip, body_pos_w=short_clip.body_pos_w + 0.02)
    with pytest.raises(ValueError, match=r"short\.npz: its bodies are up to 0\.035 m"):
        check_consistency(moved, robot, "short.npz")
    still = dataclasses.replace(short_clip, qvel=np.zeros_like(short_clip.qvel))
    with pytest.raises(ValueError, match="not the derivative"):
        check_consistency(still, robot, "short.npz")
