"""The two layers of the reward, from settings."""

from collections.abc import Iterable

from tlr_exp.config.settings import Settings
from tlr_exp.reward.split import RewardSplit
from tlr_exp.robot.timing import CONTROL_DT_S


def build_split(settings: Settings, term_names: Iterable[str]) -> RewardSplit:
    """The two layers, the lower one at its configured scale.

    ``term_names`` are those of the environment that records the terms, in its order.
    """
    reward = settings.reward
    optimizing = {name: reward.penalty_scale * value for name, value in reward.optimizing.items()}
    return RewardSplit(reward.goal, optimizing, CONTROL_DT_S, term_names)


def build_judged_split(settings: Settings, term_names: Iterable[str]) -> RewardSplit:
    """The two layers as an evaluation judges them: the lower one at full scale.

    So runs whose lower layer was trained at different scales can be compared.
    """
    reward = settings.reward
    return RewardSplit(reward.goal, reward.optimizing, CONTROL_DT_S, term_names)
