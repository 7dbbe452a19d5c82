"""Which stage of a curriculum a training is in.

A stage sets weights, which an optimizer applies (`optimizer=staged`), and limits and starts of
episodes, which the environment applies. Neither knows of the other; the training hands both on.
"""

from collections.abc import Mapping, Sequence

from tlr_exp import keys
from tlr_exp.config.settings import StageSettings
from tlr_exp.reward.split import RewardSplit

_REACHED_FROM_ABOVE = ("body_error_m",)


class Stages:
    """The stages of a curriculum, in order, and how far a training has come in them.

    Args:
        stages: those of the configuration; none where there is no curriculum.

    Attributes:
        number: of the present stage, from 0.
    """

    def __init__(self, stages: Sequence[StageSettings]) -> None:
        self.stages = tuple(stages)
        self.number = 0

    def __len__(self) -> int:
        return len(self.stages)

    @property
    def present(self) -> StageSettings:
        """The stage that the training is in; there must be one."""
        return self.stages[self.number]

    def advance(self, facts: Mapping[str, float]) -> bool:
        """Enter the next stage if all of its conditions hold; whether it was entered.

        Args:
            facts: of the last iteration, by the names of conditions.
        """
        if self.number + 1 >= len(self.stages):
            return False
        conditions = self.stages[self.number + 1].enter_when
        entered = all(_holds(name, facts[name], value) for name, value in conditions.items())
        self.number += entered
        return entered

    def state_dict(self) -> dict[str, int]:
        return {"number": self.number}

    def load_state_dict(self, state: Mapping[str, int]) -> None:
        self.number = state["number"]


def stage_facts(
    iteration: int, metrics: Mapping[str, float], split: RewardSplit
) -> dict[str, float]:
    """What conditions are compared with, from the metrics of an iteration.

    Args:
        iteration: its number, from 1.
        metrics: by name, those of the reward terms among them.
        split: the two layers of the reward.
    """
    mean_terms = {name: metrics[keys.REWARD_TERM_PREFIX + name] for name in split.term_names}
    errors = (metrics[keys.TRAIN_UPPER_BODY_ERROR], metrics[keys.TRAIN_LOWER_BODY_ERROR])
    return {
        "iteration": iteration,
        "episode_length": metrics[keys.EPISODE_LENGTH],
        "goal_share": split.goal_share(mean_terms),
        "body_error_m": sum(errors) / len(errors),
    }


def _holds(name: str, fact: float, value: float) -> bool:
    """Whether a condition holds; a fact that is not a number fulfils none."""
    return fact <= value if name in _REACHED_FROM_ABOVE else fact >= value
