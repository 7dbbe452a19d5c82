"""Another robot than the G1 by a spec alone: nothing reads the G1 behind its back.

It is the model's own 29 joints, whose hands are the last links of the wrists: six joints and six
links more than the 23-joint G1, and two points fewer.
"""

import dataclasses

import numpy as np
import pytest
import torch

from tlr_exp import keys
from tlr_exp.env.errors import tracking_errors
from tlr_exp.env.instant import Instant
from tlr_exp.env.observations import observation_dims, privileged_dim
from tlr_exp.env.tracking import TrackingEnv
from tlr_exp.motion.clip import MotionClip, clip_from_qpos
from tlr_exp.motion.importers.readings.joints import check_joints, in_order
from tlr_exp.motion.quality.check import check_clip
from tlr_exp.motion.reference import Reference
from tlr_exp.physics.native import NativePhysics
from tlr_exp.robot.g1 import G1
from tlr_exp.robot.model import Robot, build_robot
from tlr_exp.robot.spec import Joint, RobotSpec

WRISTS = ("wrist_roll", "wrist_pitch", "wrist_yaw")
HANDS = ("left_wrist_yaw_link", "right_wrist_yaw_link")


def _joint(name: str) -> Joint:
    side, _, kind = name.removesuffix("_joint").partition("_")
    elbow = next(joint for joint in G1.joints if joint.name == f"{side}_elbow_joint")
    link = f"{side}_{kind}_link"
    return dataclasses.replace(elbow, name=name, kind=kind, link=link, range=(-1.5, 1.5))


@pytest.fixture(scope="module")
def spec() -> RobotSpec:
    known = {joint.name: joint for joint in G1.joints}
    joints = tuple(known.get(name) or _joint(name) for name in G1.model_joint_names)
    pose = tuple(joint.gains["beyondmimic"].default_pos for joint in joints)
    return dataclasses.replace(
        G1,
        name="G1 with wrists",
        joints=joints,
        points=tuple(point for point in G1.points if point.name == "head"),
        hand_names=HANDS,
        arms=(*G1.arms, *WRISTS),
        stance=dataclasses.replace(G1.stance, joint_pos_rad=pose),
    )


@pytest.fixture(scope="module")
def wristed(spec) -> Robot:
    return build_robot(spec=spec)


@pytest.fixture(scope="module")
def clip(wristed) -> MotionClip:
    """One second: standing, while the wrists turn."""
    qpos = np.zeros((51, 36))
    qpos[:, 2], qpos[:, 3] = 0.78, 1.0
    qpos[:, 7:] = wristed.default_joint_pos_rad
    qpos[:, -1] += 0.5 * np.sin(np.linspace(0, 6, 51))
    return clip_from_qpos(qpos, 50.0, wristed)


def test_the_model_has_the_joints_and_bodies_of_the_spec(spec, wristed):
    model = wristed.model
    assert (model.nq, model.nv, model.nu) == (36, 35, 29)
    assert [model.joint(i).name for i in range(1, model.njnt)] == list(G1.model_joint_names)
    assert [model.body(i).name for i in wristed.body_ids] == list(spec.tracked_bodies)
    assert spec.num_bodies == G1.num_bodies + 6 - 2
    assert wristed.kp.shape == (29,)
    np.testing.assert_array_equal(model.jnt_range[1:], spec.joint_range_rad)


def test_groups_follow_the_spec(spec):
    names = [spec.tracked_bodies[i] for i in spec.upper_body]
    assert len(names) == 14 + 1
    assert set(HANDS) < set(names)
    assert sorted(spec.upper_body + spec.lower_body) == list(range(31))
    assert [spec.tracked_bodies[i] for i in spec.three_points] == [*HANDS, "head"]
    assert [spec.joint_names[i] for i in spec.arm("left")][-1] == "left_wrist_yaw_joint"


def test_a_clip_has_its_shapes_and_is_no_clip_of_the_g1(spec, clip, tmp_path):
    assert clip.qvel.shape == (51, 35)
    assert clip.body_pos_w.shape == (51, 31, 3)
    assert Reference(clip).frame(torch.tensor([3])).body_quat_w.shape == (1, 31, 4)
    clip.save(tmp_path / "wrists.npz")
    loaded = MotionClip.load(tmp_path / "wrists.npz", spec)
    np.testing.assert_array_equal(loaded.qpos, clip.qpos)
    with pytest.raises(ValueError, match=r"the 23-joint G1; unknown: left_wrist_roll_joint"):
        MotionClip.load(tmp_path / "wrists.npz", G1)
    beyond = clip.qpos.copy()
    beyond[2, -1] = 1.6
    with pytest.raises(ValueError, match=r"right_wrist_yaw_joint is 1\.600 rad at frame 2"):
        dataclasses.replace(clip, qpos=beyond)


def test_a_check_names_its_joints(clip, wristed):
    (ends,) = (f for f in check_clip(clip, wristed) if f.measure == "end and start apart")
    assert ends.place == "right_wrist_yaw_joint"


def test_files_of_29_joints_lose_none(spec):
    assert in_order(29, "mujoco", spec) == spec.joint_names
    with pytest.raises(ValueError, match="missing joints: left_wrist_roll_joint"):
        check_joints(G1.joint_names, spec)


def test_errors_are_means_over_the_groups_of_the_spec(spec, clip, wristed):
    """A hand that is 0.3 m off is 0.02 m on average over the 15 bodies of the upper body."""
    engine = NativePhysics(wristed, 1, num_threads=1)
    qpos, qvel = (torch.tensor(array[:1]) for array in (clip.qpos, clip.qvel))
    engine.set_state(torch.arange(1), qpos, qvel)
    state = engine.state()
    body_pos = state.body_pos_w.clone()
    body_pos[:, spec.tracked_bodies.index(HANDS[0]), 0] += 0.3
    frame = Reference(clip).frame(torch.tensor([0]))
    errors = tracking_errors(Instant(state._replace(body_pos_w=body_pos), frame, spec))
    assert errors[keys.UPPER_BODY_ERROR].item() == pytest.approx(0.02, abs=1e-5)
    assert errors[keys.LOWER_BODY_ERROR].item() == pytest.approx(0.0, abs=1e-5)


@pytest.mark.parametrize("observation", ["history", "reference"])
def test_an_environment_steps_it(spec, clip, wristed, settings_of, observation):
    settings = settings_of(f"env.observation={observation}")
    env = TrackingEnv(
        physics=NativePhysics(wristed, 2, num_threads=1),
        reference=Reference(clip),
        robot=wristed,
        terms={"upper_body_pos": {"sigma": 0.03}, "feet_pos": {"sigma": 0.03}},
        settings=settings.env,
        seed=0,
    )
    assert env.action_spec.shape == (2, 29)
    after = env.rollout(2)["next"]
    assert after[keys.OBSERVATION].shape == (2, 2, observation_dims(spec)[observation])
    assert after[keys.PRIVILEGED].shape == (2, 2, privileged_dim(spec))
    assert torch.isfinite(after[keys.REWARD_TERMS]).all()
