"""What a roll-out leaves behind: one robot beside its reference, step by step."""

from dataclasses import dataclass

import numpy as np

from tlr_exp.robot.spec import RobotSpec


@dataclass(frozen=True)
class Trajectory:
    """One robot and its reference at T successive control steps, float64, world frame, SI units.

    Row k is the instant after control step k + 1, with the reference that this step was to reach.
    ``qpos`` and ``qvel`` follow MuJoCo's conventions; ``joint_torque`` is that of the last physics
    step of each control step. ``terms`` holds the raw reward terms by name; ``unstable`` is true
    where the physics state stopped being finite (the states are then those of the last finite
    instant). Shapes are those of the G1.
    """

    spec: RobotSpec
    control_dt_s: float
    qpos: np.ndarray  # [T, 30]
    reference_qpos: np.ndarray  # [T, 30]
    qvel: np.ndarray  # [T, 29]
    reference_qvel: np.ndarray  # [T, 29]
    joint_torque: np.ndarray  # [T, 23] N m
    body_pos_w: np.ndarray  # [T, 27, 3]
    reference_body_pos_w: np.ndarray  # [T, 27, 3]
    terms: dict[str, np.ndarray]  # each [T]
    unstable: np.ndarray  # [T] bool

    @property
    def num_steps(self) -> int:
        return len(self.qpos)
