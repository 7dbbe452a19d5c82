"""The robot against the floor: heights, free flight, contacts."""

import mujoco
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tlr_exp.motion.quality.floor import (
    clip_ground,
    floor_contacts,
    floor_geoms,
    free_fall,
    steady_contact,
    stretches,
)

GRAVITY = 9.81


def test_lowest_points_are_those_that_mujoco_finds(robot, swaying_clip):
    """MuJoCo's own distance of a geom from the floor, a cylinder and an ellipsoid included."""
    floor = floor_contacts(swaying_clip, robot)
    data = mujoco.MjData(robot.model)
    (plane,) = np.flatnonzero(robot.model.geom_type == mujoco.mjtGeom.mjGEOM_PLANE)
    for t in range(0, swaying_clip.num_frames, 10):
        data.qpos[:] = swaying_clip.qpos[t]
        mujoco.mj_kinematics(robot.model, data)
        distances = [
            mujoco.mj_geomDistance(robot.model, data, int(plane), int(g), 5.0, None)
            for g in floor_geoms(robot.model)
        ]
        assert floor.lowest[t] == pytest.approx(min(distances), abs=1e-9)


def test_every_part_of_the_robot_but_the_foot_boxes_counts(robot):
    names = [robot.model.geom(int(g)).name for g in floor_geoms(robot.model)]
    assert {"head_collision", "left_hand_collision", "right_foot2_collision"} <= set(names)
    assert "left_foot_box_collision" not in names  # the model has no pair of it with the floor


def test_a_model_that_touches_nothing_is_refused():
    model = mujoco.MjModel.from_xml_string(
        '<mujoco><worldbody><body><freejoint/><geom size="1" contype="0" conaffinity="0"/></body>'
        "</worldbody></mujoco>"
    )
    with pytest.raises(ValueError, match="no geom of the robot can touch the floor"):
        floor_geoms(model)


@given(st.floats(-3.0, 3.0), st.integers(3, 40), st.sampled_from([30.0, 50.0, 120.0]))
def test_a_parabola_of_gravity_is_free_fall(speed, frames, fps):
    time = np.arange(frames) / fps
    height = 0.8 + speed * time - GRAVITY * time**2 / 2
    assert free_fall(height, np.ones(frames, dtype=bool), fps, GRAVITY).all()


@given(st.floats(-3.0, 3.0), st.integers(3, 40), st.floats(-1.0, 0.5))
def test_a_parabola_of_anything_else_is_not(speed, frames, share):
    time = np.arange(frames) / 50
    height = 0.8 + speed * time - share * GRAVITY * time**2 / 2
    assert not free_fall(height, np.ones(frames, dtype=bool), 50, GRAVITY).any()


def test_only_the_fall_of_a_hovering_robot_is_free():
    """A second of hovering, 0.3 s of falling, all without contact; half a window of doubt."""
    time = np.arange(66) / 50
    height = 3 - GRAVITY * np.maximum(time - 1.0, 0.0) ** 2 / 2
    falls = free_fall(height, np.ones(66, dtype=bool), 50, GRAVITY)
    assert falls[52:].all()
    assert not falls[:46].any()


def test_stretches():
    flags = np.array([1, 1, 0, 0, 1, 0, 1], dtype=bool)
    assert list(stretches(flags)) == [(0, 2), (4, 5), (6, 7)]
    assert list(stretches(np.zeros(3, dtype=bool))) == []


def test_steady_contact_leaves_out_touch_down_and_take_off():
    """0.06 s at 50 Hz are three frames; where the clip begins or ends nothing touches down."""
    contact = np.zeros(40, dtype=bool)
    contact[:10] = contact[15:30] = contact[33:38] = True
    steady = np.flatnonzero(steady_contact(contact, 50.0))
    assert steady.tolist() == [*range(7), *range(18, 27)]


def test_the_clips_own_floor_keeps_slopes_and_drops_hops():
    slope = np.linspace(0.0, 0.1, 201)
    level = slope.copy()
    level[100:120] += 0.05  # a hop of 0.4 s
    level[150:160] = np.nan  # flight
    ground = clip_ground(level, 50.0)
    np.testing.assert_allclose(ground[30:-30], slope[30:-30], atol=0.012)
    assert ground[110] < slope[110] + 0.012
    np.testing.assert_array_equal(clip_ground(np.full(9, np.nan), 50.0), 0.0)
