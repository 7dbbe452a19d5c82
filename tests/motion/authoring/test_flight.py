"""When the feet leave the floor, and how the pelvis turns then."""

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tlr_exp.motion.authoring.flight import flights, momentum_turn, turning_inertia
from tlr_exp.motion.authoring.ik import BodySolver
from tlr_exp.motion.authoring.keyframes import build_clip
from tlr_exp.motion.authoring.plan import BodyTargets
from tlr_exp.motion.authoring.script import KeyframeError
from tlr_exp.motion.clip import clip_from_qpos
from tlr_exp.motion.dynamics import centroidal, inverse_dynamics
from tlr_exp.robot.g1 import G1

TIMES = np.arange(20) / 50


def _on_floor(left: str, right: str) -> np.ndarray:
    return np.array([[mark == "x" for mark in foot] for foot in (left, right)])


def test_flights_are_where_neither_foot_is_on_the_floor():
    on_floor = _on_floor("xxxxxx....xxxxxxxxxx", "xxxxx...xxxxxxxxxxxx")
    assert flights(on_floor, TIMES) == [(5, 8)]
    assert flights(_on_floor("x" * 20, "." * 20), TIMES) == []


@pytest.mark.parametrize(
    ("floor", "time_s"),
    [
        ("...xxxxxxxxxxxxxxxxx", "0.00"),
        ("xxxxxxxxxxxxxxxxx...", "0.38"),
        ("xxxxxxx..xxx..xxxxxx", "0.22"),
    ],
    ids=["first", "last", "hop"],
)
def test_a_motion_stands_before_between_and_after_flights(floor, time_s):
    with pytest.raises(KeyframeError, match=rf"about {time_s} s it stands for less than 0\.1 s"):
        flights(_on_floor(floor, floor), TIMES)


def test_a_flight_at_the_end_is_explained(robot):
    text = """
keyframes:
  - {time_s: 0.0}
  - {time_s: 1.0, left_foot: {x_m: 0.1}, right_foot: {x_m: 0.1}}
"""
    with pytest.raises(KeyframeError, match="both feet move"):
        build_clip(text, robot)


def test_turning_inertia_is_the_momentum_of_small_turns_found_by_inverse_kinematics(
    authored, robot
):
    clip, _ = authored("jump")
    t, angle = round(1.5 * clip.fps), 1e-3
    com = centroidal(clip, robot).com[t]
    feet = [G1.tracked_bodies.index(foot) for foot in G1.foot_names]
    columns = []
    for axis in np.eye(3):
        turns = Rotation.from_rotvec(np.outer([-angle, 0.0, angle], axis))
        quats = turns * Rotation.from_quat(clip.qpos[t, 3:7], scalar_first=True)
        targets = BodyTargets(
            times_s=np.arange(3) / 50,
            com_xy=np.tile(com[:2], (3, 1)),
            pelvis_height=np.full(3, clip.qpos[t, 2]),
            pelvis_quat=quats.as_quat(scalar_first=True),
            foot_pos=np.repeat(clip.body_pos_w[t, feet][:, None], 3, axis=1),
            foot_quat=np.repeat(clip.body_quat_w[t, feet][:, None], 3, axis=1),
            joint_pos=np.tile(clip.qpos[t, 7:], (3, 1)),
            com_height=np.full(3, com[2]),
        )
        turned = clip_from_qpos(BodySolver(robot).solve(targets), clip.fps, robot)
        columns.append(centroidal(turned, robot).angular_momentum[1] / (angle * clip.fps))
    np.testing.assert_allclose(turning_inertia(clip.qpos[t], robot), np.array(columns).T, atol=2e-3)


def test_a_clip_that_keeps_its_momentum_is_left_as_it_is(authored, robot):
    clip, plan = authored("jump")
    again = momentum_turn(clip, robot, plan.flights, plan.turn)
    # The fixture's plan knows of no turn, so that small is what remains to be done in flight.
    up, down = plan.flights[0]
    assert np.abs(np.diff(again[up : down + 1], axis=0) * clip.fps).max() < 0.05


def test_mujoco_carries_the_flight_on_from_its_first_frame(authored, robot):
    """Momenta and limbs given, mechanics does the rest: joint targets alone reach the landing."""
    clip, plan = authored("jump")
    up, down = plan.flights[0]
    torque = inverse_dynamics(clip, robot).joint_torque
    data = mujoco.MjData(robot.model)
    start = up + 2
    data.qpos[:], data.qvel[:] = clip.qpos[start], clip.qvel[start]
    for t in range(start, down - 1):
        for part in (0.25, 0.5, 0.75, 1.0):
            joints, speeds, torques = (
                (1 - part) * rows[t] + part * rows[t + 1]
                for rows in (clip.qpos[:, 7:], clip.qvel[:, 6:], torque)
            )
            data.ctrl[:] = joints + (torques + robot.kd * speeds) / robot.kp
            mujoco.mj_step(robot.model, data)
    end = clip.qpos[down - 1]
    assert np.linalg.norm(data.qpos[:3] - end[:3]) < 0.01
    turn = np.zeros(3)
    mujoco.mju_subQuat(turn, data.qpos[3:7], end[3:7])
    assert np.degrees(np.linalg.norm(turn)) < 2.0


def test_without_a_plan_the_momentum_would_change(authored, robot):
    """What the planner does: the same limbs on a pelvis held as written tumble."""
    clip, plan = authored("jump")
    up, down = plan.flights[0]
    kept = np.ptp(centroidal(clip, robot).angular_momentum[up : down + 1], axis=0).max()
    written = clip.qpos.copy()
    written[:, 3:7] = plan.pelvis_quat
    held = centroidal(clip_from_qpos(written, clip.fps, robot), robot).angular_momentum
    assert np.ptp(held[up : down + 1], axis=0).max() > 20 * kept
