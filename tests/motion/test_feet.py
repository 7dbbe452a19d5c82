"""Soles and support polygons."""

import mujoco
import numpy as np
import pytest
from standing import support_margin

from tlr_exp.motion.feet import foot_extremes, half_planes, hip_offset, sole_points
from tlr_exp.robot.g1 import G1
from tlr_exp.robot.model import build_robot


def test_sole_is_that_of_the_capsules(robot):
    """Menagerie: capsules of radius 20 mm from -45 to 120 mm, of 10 mm at y = +-26 mm."""
    for side in range(2):
        points = sole_points(robot, side)
        assert points.shape == (6, 3)
        np.testing.assert_allclose(points[:, 2], -0.035, atol=1e-9)
        np.testing.assert_allclose([points[:, 0].min(), points[:, 0].max()], [-0.045, 0.12])
        np.testing.assert_allclose(np.abs(points[:, 1]).max(), 0.0265, atol=6e-4)


def test_lowest_point_agrees_with_mujocos_distance_to_the_floor(robot):
    data = mujoco.MjData(robot.model)
    data.qpos[:7] = [0, 0, 0.8, 0.99, 0.1, -0.08, 0.05]
    mujoco.mj_forward(robot.model, data)
    floor = mujoco.mj_name2id(robot.model, mujoco.mjtObj.mjOBJ_GEOM, "floor")
    for side, name in enumerate(("left", "right")):
        centres, radii = foot_extremes(robot, side)
        body = robot.foot_body_ids[side]
        heights = (data.xpos[body] + centres @ data.xmat[body].reshape(3, 3).T)[:, 2] - radii
        distances = [
            mujoco.mj_geomDistance(
                robot.model, data, floor, robot.model.geom(f"{name}_foot{i}_collision").id, 2, None
            )
            for i in (1, 2, 3)
        ]
        assert heights.min() == pytest.approx(min(distances), abs=1e-9)


def test_contact_choice_does_not_change_the_sole(robot):
    np.testing.assert_array_equal(
        sole_points(build_robot(collisions="feet"), 0), sole_points(robot, 0)
    )


@pytest.mark.parametrize(
    ("geom", "lowest", "count"),
    [
        ('type="sphere" size="0.01" pos="0.05 0 -0.03"', -0.04, 1),
        ('type="box" size="0.1 0.03 0.01" pos="0.03 0 -0.02"', -0.03, 4),
    ],
)
def test_other_shapes_of_feet(tmp_path, robot, geom, lowest, count):
    points = sole_points(_robot_with_foot(tmp_path, geom), 0)
    assert len(points) == count
    np.testing.assert_allclose(points[:, 2], lowest)


def test_unknown_shape_is_named(tmp_path):
    with pytest.raises(ValueError, match="ELLIPSOID"):
        sole_points(_robot_with_foot(tmp_path, 'type="ellipsoid" size="0.1 0.03 0.01"'), 0)


def test_foot_that_touches_nothing_is_named(tmp_path):
    geom = 'type="sphere" size="0.01" contype="0" conaffinity="0"'
    with pytest.raises(ValueError, match="left_ankle_roll_link"):
        sole_points(_robot_with_foot(tmp_path, geom), 0)


def _robot_with_foot(tmp_path, geom: str):
    """A G1 of bare bones whose feet carry one geom each."""
    inertia = '<inertial pos="0 0 0" mass="1" diaginertia="0.1 0.1 0.1"/>'
    bodies = "".join(
        f'<body name="{link}"><joint name="{joint}" axis="0 1 0"/>{inertia}'
        + (f"<geom {geom}/>" if "ankle_roll" in link else "")
        + "</body>"
        for joint, link in zip(G1.joint_names, G1.link_names[1:], strict=True)
    )
    path = tmp_path / "robot.xml"
    path.write_text(
        '<mujoco><compiler angle="radian"/><worldbody>'
        '<geom name="floor" type="plane" size="1 1 1"/>'
        f'<body name="pelvis"><freejoint/>{inertia}{bodies}</body></worldbody></mujoco>'
    )
    return build_robot(path)


def test_half_planes_of_a_rectangle():
    planes = half_planes(np.array([[0, 0], [2, 0], [2, 1], [0, 1], [1, 0.5]], float))
    assert len(planes) == 4
    distances = planes[:, :2] @ [0.5, 0.4] + planes[:, 2]
    np.testing.assert_allclose(sorted(distances), [-1.5, -0.6, -0.5, -0.4])


@pytest.mark.parametrize(
    ("position", "margin"), [([1.0, 0.5], 0.5), ([0.1, 0.5], 0.1), ([2.3, 0.5], -0.3)]
)
def test_support_margin(position, margin):
    corners = np.array([[0, 0], [2, 0], [2, 1], [0, 1]], float)
    assert support_margin(corners, np.array(position)) == pytest.approx(margin)


def test_hip_lies_beside_and_below_the_pelvis(robot):
    """Menagerie: 64.452 + 52 mm to the side, 102.7 + 30.465 mm down, turned back by the roll."""
    left, right = hip_offset(robot, 0), hip_offset(robot, 1)
    np.testing.assert_allclose(left * [1, -1, 1], right, atol=1e-9)
    assert left[1] == pytest.approx(0.064452 + 0.052)
