"""How the robots of one simulation differ from their model: MuJoCo's per-simulation model fields.

Values are absolute or factors of the model's own, never of what was there before, so that the same
values always give the same simulation.
"""

from collections.abc import Mapping

import numpy as np
from mujoco.batch import Batch

from tlr_exp.robot.model import Robot

VARIATIONS = ("friction", "mass", "com_m", "kp", "kd", "armature")
_OF_THE_ROOT = 6  # degrees of freedom before those of the joints
_INERTIAL = ("mass", "com_m", "armature")  # MuJoCo derives constants from these


class Variations:
    """Writes what differs into the model fields of a batch of simulations."""

    def __init__(self, batch: Batch, robot: Robot) -> None:
        self._batch = batch
        self._model = robot.model
        self._torso = int(robot.model.body(robot.spec.torso_name).id)

    def write(self, ids: np.ndarray, values: Mapping[str, np.ndarray]) -> None:
        """Let simulations differ; they have to be set to a state before they are stepped again.

        Args:
            ids: [n], ascending.
            values: by the names in ``VARIATIONS``; shapes as in ``Physics.vary``.
        """
        for name, value in values.items():
            getattr(self, f"_write_{name}")(ids, value)
        if any(name in values for name in _INERTIAL):
            self._batch.set_const(ids)

    def _write_friction(self, ids: np.ndarray, coefficient: np.ndarray) -> None:
        # A pair of its own has its own coefficients, two sliding ones; else the larger of two geoms
        # counts.
        self._batch.expand("geom_friction")[ids, :, :1] = coefficient[:, None, None]
        if self._model.npair:
            self._batch.expand("pair_friction")[ids, :, :2] = coefficient[:, None, None]

    def _write_mass(self, ids: np.ndarray, factor: np.ndarray) -> None:
        self._batch.expand("body_mass")[ids] = self._model.body_mass * factor
        self._batch.expand("body_inertia")[ids] = self._model.body_inertia * factor[:, :, None]

    def _write_com_m(self, ids: np.ndarray, offset: np.ndarray) -> None:
        torso = self._torso
        self._batch.expand("body_ipos")[ids, torso] = self._model.body_ipos[torso] + offset

    def _write_kp(self, ids: np.ndarray, factor: np.ndarray) -> None:
        self._batch.expand("actuator_gainprm")[ids, :, 0] = (
            self._model.actuator_gainprm[:, 0] * factor
        )
        self._batch.expand("actuator_biasprm")[ids, :, 1] = (
            self._model.actuator_biasprm[:, 1] * factor
        )

    def _write_kd(self, ids: np.ndarray, factor: np.ndarray) -> None:
        self._batch.expand("actuator_biasprm")[ids, :, 2] = (
            self._model.actuator_biasprm[:, 2] * factor
        )

    def _write_armature(self, ids: np.ndarray, factor: np.ndarray) -> None:
        joints = slice(_OF_THE_ROOT, None)
        armature = self._model.dof_armature[joints] * factor
        self._batch.expand("dof_armature")[ids, joints] = armature
