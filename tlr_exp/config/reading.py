"""Whether a run reads the paper as its word ``reading`` says.

Some readings choose a whole part (``override`` in ``conf/reading``). Hydra passes over such a
choice where the command, or a curriculum, chooses the part, too.
"""

from collections.abc import Iterator

from tlr_exp.config.nested import has_part
from tlr_exp.config.settings import RewardSettings, Settings

# The classes of the parts that readings choose; each part is called as its reading.
_OPTIMIZERS = {
    "smoothed": "SmoothedWeights",
    "under_curriculum": "UnderCurriculum",
    "when_tracking": "WhenTracking",
}
_OBJECTIVES = {"normalized": "NormalizedTerms"}
_REWARD, _LINEAR_LIMITS = "linear_limits", {"dof_pos_excess", "dof_vel_excess"}


def reading_problems(settings: Settings) -> Iterator[str]:
    """One line where the part that the reading chooses is not the one that the run has."""
    name = settings.reading
    if name in _OPTIMIZERS and not has_part(settings.optimizer, _OPTIMIZERS[name]):
        yield (
            f"{_leave_out(name, 'optimizer')}; to have both, leave out the latter and say "
            "optimizer@optimizer.inner=NAME instead"
        )
    if name in _OBJECTIVES and not has_part(settings.reward.objective, _OBJECTIVES[name]):
        yield (
            f"{_leave_out(name, 'reward/objective')}; to have both, leave out the latter and say "
            "reward/objective@reward.objective.inner=NAME instead"
        )
    if name == _REWARD and not _limits_are_linear(settings.reward):
        yield _leave_out(name, "reward")


def _limits_are_linear(reward: RewardSettings) -> bool:
    """Whether it is the paper's reward with ASAP's form of the limits, and not ASAP's own."""
    return "body_pos" in reward.goal and bool({*reward.optimizing} & _LINEAR_LIMITS)


def _leave_out(name: str, group: str) -> str:
    besides = ", or a curriculum" if group == "optimizer" else ""
    return (
        f"reading={name} chooses {group}={name}, but another {group} is chosen besides: leave out "
        f"reading={name} or what chooses the other ({group}=NAME{besides})"
    )
