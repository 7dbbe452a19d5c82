"""What a motion asks of the motors."""

import numpy as np


def mean_torque(joint_torque: np.ndarray) -> float:
    """Mean absolute torque of a joint in N m: [T, joints] -> one number."""
    return float(np.abs(joint_torque).mean())


def mean_power(joint_torque: np.ndarray, joint_vel: np.ndarray) -> float:
    """Mechanical power of all joints in W, mean over time: [T, joints] twice -> one number.

    The sum over joints of |torque * velocity|: braking costs as much as driving, as in a motor
    that gives nothing back.
    """
    return float(np.abs(joint_torque * joint_vel).sum(axis=1).mean())
