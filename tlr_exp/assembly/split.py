"""The two layers of the reward, from settings."""

from tlr_exp.config.settings import Settings
from tlr_exp.reward.split import RewardSplit
from tlr_exp.robot.timing import CONTROL_DT_S


def build_split(settings: Settings) -> RewardSplit:
    """The two layers, the lower one at its configured scale."""
    reward = settings.reward
    optimizing = {name: reward.penalty_scale * value for name, value in reward.optimizing.items()}
    return RewardSplit(reward.goal, optimizing, CONTROL_DT_S)


def build_judged_split(settings: Settings) -> RewardSplit:
    """The two layers as an evaluation judges them: the lower one at full scale.

    So runs whose lower layer was trained at different scales can be compared.
    """
    return RewardSplit(settings.reward.goal, settings.reward.optimizing, CONTROL_DT_S)
