"""Torque and power by hand."""

import numpy as np
import pytest

from tlr_exp.evaluation.effort import mean_power, mean_torque

TORQUE = np.array([[2.0, -4.0], [0.0, 6.0]])  # two instants, two joints
VELOCITY = np.array([[1.0, 0.5], [9.0, -1.0]])


def test_torque_is_the_mean_size_over_joints_and_time():
    assert mean_torque(TORQUE) == pytest.approx(3.0)


def test_power_sums_joints_and_counts_braking_as_work():
    # |2 * 1| + |-4 * 0.5| = 4 W at first, |0 * 9| + |6 * -1| = 6 W then.
    assert mean_power(TORQUE, VELOCITY) == pytest.approx(5.0)
