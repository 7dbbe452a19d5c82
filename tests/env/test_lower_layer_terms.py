"""The terms of the lower layer, one number each by hand."""

import math

import pytest
import torch

from tlr_exp.env import terms


def test_base_height_by_hand(tracking):
    # 0.2 m below the reference: 0.04 m^2.
    step = tracking()
    step.state.qpos[0, 2] -= 0.2
    assert terms.base_height(step).item() == pytest.approx(0.04, rel=1e-4)


def test_ang_vel_xy_by_hand_is_roll_and_pitch_rate_of_the_base_frame(tracking):
    # MuJoCo's qvel[3:6] is in the base frame: 3^2 + 4^2 = 25, whichever way the pelvis points.
    step = tracking()
    step.state.qvel[0, :6] = torch.tensor([9.0, 9.0, 9.0, 3.0, -4.0, 7.0])
    assert terms.ang_vel_xy(step).item() == pytest.approx(25.0)


def test_lin_vel_z_by_hand_is_along_the_axis_of_a_tilted_base(tracking):
    # The base is pitched forward by 30 deg about y, so its z axis is (sin 30, 0, cos 30) in the
    # world: velocity (2, 5, 0) m/s has 2 * 0.5 = 1 m/s along it. Upright it had none.
    step = tracking(2)
    half = math.radians(15.0)
    step.state.qpos[0, 3:7] = torch.tensor([math.cos(half), 0.0, math.sin(half), 0.0])
    step.state.qpos[1, 3:7] = torch.tensor([1.0, 0.0, 0.0, 0.0])
    step.state.qvel[:, :3] = torch.tensor([2.0, 5.0, 0.0])
    assert terms.lin_vel_z(step).tolist() == pytest.approx([1.0, 0.0], rel=1e-5)


def test_dof_pos_limits_by_hand(tracking):
    # Range [-1, 3], midpoint 1; margin 0.1 of the half range of 2 rad is 0.2 rad:
    # free from -0.8 to 2.8. At 2.9: 0.1^2; at 3.5, beyond the limit: 0.7^2; at -1.3: 0.5^2.
    # (0.01 + 0.49 + 0.25)/23.
    step = tracking()
    step.state.qpos[0, 7:] = 0.0
    step.state.qpos[0, 7:10] = torch.tensor([2.9, 3.5, -1.3])
    found = terms.dof_pos_limits(step, margin=0.1).item()
    assert found == pytest.approx(0.75 / 23, rel=1e-4)


@pytest.mark.parametrize(
    ("place", "edges"), [(("qpos", slice(7, None)), (-0.5, 2.5)), (("qvel", slice(6, None)), 7.5)]
)
def test_limits_begin_exactly_at_the_edge_of_the_margin(place, edges, tracking):
    # Margin 0.25: 0.25 * 2 rad before both ends of [-1, 3]; 0.75 * 10 rad/s. Exact in float32.
    step = tracking()
    field, columns = place
    low, high = edges if isinstance(edges, tuple) else (-edges, edges)
    term = terms.dof_pos_limits if field == "qpos" else terms.dof_vel_limits
    for edge, beyond in ((low, low - 0.01), (high, high + 0.01)):
        getattr(step.state, field)[:, columns] = edge
        assert term(step, margin=0.25).item() == 0.0
        # All joints 0.01 beyond: the mean is 0.01^2.
        getattr(step.state, field)[:, columns] = beyond
        assert term(step, margin=0.25).item() == pytest.approx(1e-4, rel=1e-3)


def test_dof_vel_limits_by_hand(tracking):
    # 10 rad/s, margin 0.1: free up to 9. At -11: 2^2; at 9.5: 0.5^2; 4.25/23.
    step = tracking()
    step.state.qvel[0] = 0.0
    step.state.qvel[0, 6:8] = torch.tensor([-11.0, 9.5])
    step.state.qvel[0, :6] = 100.0
    assert terms.dof_vel_limits(step, margin=0.1).item() == pytest.approx(4.25 / 23, rel=1e-4)


def test_torque_limits_by_hand(tracking):
    # 50 N m, margin 0.1: free up to 45. At -50: 5^2; at 46: 1; at 45: 0; 26/23.
    step = tracking()
    step.state.joint_torque[0, :3] = torch.tensor([-50.0, 46.0, 45.0])
    assert terms.torque_limits(step, margin=0.1).item() == pytest.approx(26 / 23, rel=1e-4)


def test_limits_are_those_of_each_joint(tracking):
    step = tracking()
    step.limits.effort_nm[5] = 100.0
    step.state.joint_torque[0, :] = 0.0
    step.state.joint_torque[0, 5] = 90.0
    assert terms.torque_limits(step, margin=0.1).item() == 0.0
    step.state.joint_torque[0, 6] = 90.0  # 45 above the others' edge
    assert terms.torque_limits(step, margin=0.1).item() == pytest.approx(45**2 / 23, rel=1e-4)


def test_action_smoothness_by_hand(tracking):
    # Changes of 0.5 and -2 in two of 23 actions: 0.25 + 4, summed.
    step = tracking()
    step.action[0, :2] = torch.tensor([1.5, -1.0])
    step.previous_action[0, :2] = torch.tensor([1.0, 1.0])
    assert terms.action_smoothness(step).item() == pytest.approx(4.25)


def test_torques_by_hand(tracking):
    step = tracking()
    step.state.joint_torque[0, [0, 22]] = torch.tensor([3.0, -4.0])
    assert terms.torques(step).item() == pytest.approx(25.0)


def test_termination_is_one_where_the_episode_failed(tracking):
    step = tracking(3)
    step.terminated[1] = True
    assert terms.termination(step).tolist() == [0.0, 1.0, 0.0]
