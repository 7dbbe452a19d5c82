"""What limits of docs/motions.md rest on: what becomes of a robot that starts as a clip says."""

import mujoco
import numpy as np
import pytest


def dropped(standing: np.ndarray, robot, height: float) -> tuple[float, float, float]:
    """Start standing ``height`` m over the floor, hold the pose for a second.

    Returns:
        The largest upward speed of the pelvis (m/s) and force of the floor (in weights of the
        robot) in the first 0.3 s, and the largest tilt (degrees) within the second.
    """
    model, data = robot.model, mujoco.MjData(robot.model)
    data.qpos[:] = standing[0]
    data.qpos[2] += height
    data.ctrl[:] = standing[0, 7:]
    weight = model.body("pelvis").subtreemass[0] * 9.81
    speed, force, upright = [], [], []
    for _ in range(200):
        mujoco.mj_step(model, data)
        speed.append(data.qvel[2])
        force.append(abs(data.sensordata.reshape(-1, 3)[:, 2].sum()) / weight)
        x, y = data.qpos[4:6]
        upright.append(1 - 2 * (x * x + y * y))
    return max(speed[:60]), max(force[:60]), float(np.degrees(np.arccos(min(upright))))


@pytest.mark.parametrize(
    ("millimetres", "speed", "force", "falls"),
    [(-5, 0.05, 2.5, False), (-30, 0.55, 13.5, False), (-50, 0.98, 22.5, True)],
)
def test_a_robot_in_the_floor_is_thrown_out(standing, robot, millimetres, speed, force, falls):
    measured = dropped(standing, robot, millimetres / 1000)
    assert measured[:2] == pytest.approx((speed, force), rel=0.15)
    assert (measured[2] > 45) == falls


@pytest.mark.parametrize(("millimetres", "force"), [(10, 4.6), (50, 9.6), (70, 12.2), (100, 15.7)])
def test_a_robot_over_the_floor_lands_on_its_feet(standing, robot, millimetres, force):
    speed, measured, tilt = dropped(standing, robot, millimetres / 1000)
    assert measured == pytest.approx(force, rel=0.15)
    assert speed < 0.15
    assert tilt < 20


def test_what_no_motor_can_do(standing, robot):
    """The largest acceleration that a motor can give its joint, with the robot in the air."""
    data = mujoco.MjData(robot.model)
    data.qpos[:] = standing[0]
    mujoco.mj_forward(robot.model, data)
    unit = np.eye(robot.model.nv)
    response = np.zeros_like(unit)
    mujoco.mj_solveM(robot.model, data, response, unit)
    largest = robot.effort_limit_nm * np.diag(response)[6:]
    names = [robot.model.joint(i).name for i in range(1, robot.model.njnt)]
    by_name = dict(zip(names, largest, strict=True))
    assert by_name["waist_roll_joint"] == pytest.approx(411, abs=1)
    assert by_name["left_shoulder_pitch_joint"] == pytest.approx(603, abs=1)
    assert by_name["left_knee_joint"] == pytest.approx(2212, abs=2)
    assert min(largest) == by_name["waist_roll_joint"]
