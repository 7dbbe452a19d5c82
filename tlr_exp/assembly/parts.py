"""Parts that the check of a configuration builds and the run then uses: nothing is built twice."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from tlr_exp.motion.clip import MotionClip
    from tlr_exp.optimizer.protocol import WeightOptimizer
    from tlr_exp.reward.objectives import Objective
    from tlr_exp.robot.model import Robot


@dataclass(frozen=True)
class Parts:
    """The parts of a run that only building them can refuse, built.

    Attributes:
        robot: as configured.
        clip: the motion at the control rate; of a run that keeps its motion, that counts instead.
        objective: of the weight search.
        weight_optimizer: as at the start of a run; it keeps state, so that it serves one run.
    """

    robot: Robot
    clip: MotionClip
    objective: Objective
    weight_optimizer: WeightOptimizer
