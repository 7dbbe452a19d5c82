"""The robot of a run, from settings."""

from tlr_exp.config.settings import EnvSettings
from tlr_exp.robot.g1 import G1
from tlr_exp.robot.spec import RobotSpec


def spec_of(settings: EnvSettings) -> RobotSpec:
    """The robot of a configuration; the G1 is the only one so far, whatever the settings."""
    return G1
