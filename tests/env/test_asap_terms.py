"""ASAP's forms of the lower layer: linear limits, and terms on the feet."""

import math

import pytest
import torch
from scipy.spatial.transform import Rotation

from tlr_exp.env import terms
from tlr_exp.robot.g1 import G1

FEET = [G1.tracked_bodies.index(f"{side}_ankle_roll_link") for side in ("left", "right")]


def test_linear_excesses_by_hand(tracking):
    # Free from -0.9 to 2.9 rad, up to 9.5 rad/s and 47.5 N m: the margin is 0.05.
    step = tracking()
    step.state.qpos[0, 7:] = 0.0
    step.state.qpos[0, 7:10] = torch.tensor([2.95, 3.5, -1.3])  # 0.05 + 0.6 + 0.4
    step.state.qvel[0] = 0.0
    step.state.qvel[0, 6:9] = torch.tensor([-9.75, 20.0, 9.0])  # 0.25 + 1, clipped, + 0
    step.state.joint_torque[0, :3] = torch.tensor([-50.0, 48.0, 45.0])  # 2.5 + 0.5
    assert terms.dof_pos_excess(step, margin=0.05).item() == pytest.approx(1.05, rel=1e-4)
    assert terms.dof_vel_excess(step, margin=0.05).item() == pytest.approx(1.25, rel=1e-4)
    assert terms.torque_excess(step, margin=0.05).item() == pytest.approx(3.0, rel=1e-4)


def turned(*rotation_vector_deg: float) -> torch.Tensor:
    rotation = Rotation.from_rotvec(rotation_vector_deg, degrees=True)
    return torch.tensor(rotation.as_quat(scalar_first=True), dtype=torch.float32)


def test_feet_orientation_by_hand(tracking):
    # Rolled by 30 deg: sin 30 of gravity is along the sole; turned, none; on its toes, all.
    step = tracking()
    step.state.body_quat_w[0, FEET[0]] = turned(30.0, 0.0, 0.0)
    step.state.body_quat_w[0, FEET[1]] = turned(0.0, 0.0, 70.0)
    assert terms.feet_orientation(step).item() == pytest.approx(0.5, rel=1e-4)
    step.state.body_quat_w[0, FEET[1]] = turned(0.0, -90.0, 0.0)
    assert terms.feet_orientation(step).item() == pytest.approx(1.5, rel=1e-4)


def test_feet_heading_by_hand_takes_the_short_way_round(tracking):
    # The pelvis points to 170 deg. Feet at -170 and 150 deg are 20 deg away, each.
    step = tracking()
    step.state.qpos[0, 3:7] = turned(0.0, 0.0, 170.0)
    step.state.body_quat_w[0, FEET[0]] = turned(0.0, 0.0, -170.0)
    step.state.body_quat_w[0, FEET[1]] = turned(0.0, 0.0, 150.0)
    assert terms.feet_heading(step).item() == pytest.approx(math.radians(40.0), rel=1e-4)


def test_slippage_by_hand_is_that_of_feet_on_the_ground(tracking):
    # The left foot touches and slides at 5 m/s, the right one swings.
    force = torch.tensor([[[0.0, 0.0, 300.0], [0.0, 0.9, 0.0]]])
    step = tracking(foot_contact_force=force)
    step.state.body_lin_vel_w[0, FEET[0]] = torch.tensor([3.0, 0.0, 4.0])
    step.state.body_lin_vel_w[0, FEET[1]] = torch.tensor([9.0, 0.0, 0.0])
    assert terms.slippage(step).item() == pytest.approx(5.0)
