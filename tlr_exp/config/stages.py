"""What the stages of a curriculum may be."""

from collections.abc import Iterator

from tlr_exp.config.checks import SettingError, check_above, check_at_least, check_within, refusal
from tlr_exp.config.limits import STAGE_CONDITIONS
from tlr_exp.config.nested import has_part
from tlr_exp.config.settings import Settings, StageSettings

STAGED = "StagedWeights"  # the optimizer that applies the weights of stages
SHARE_CONDITION = "goal_share"


def stage_problems(settings: Settings) -> Iterator[str]:
    """One line for each thing that a stage cannot be."""
    if not settings.stages and has_part(settings.optimizer, STAGED):
        yield (
            "stages is empty, and optimizer=staged applies the weights of stages: choose a "
            "curriculum, such as curriculum=hierarchical, or state stages, or use another optimizer"
        )
    for number, stage in enumerate(settings.stages):
        key = f"stages[{number}]"
        for check in (_check_conditions, _check_weights, _check_episodes):
            try:
                check(key, stage, settings, number)
            except SettingError as error:
                yield str(error)


def _check_conditions(key: str, stage: StageSettings, settings: Settings, number: int) -> None:
    if number == 0 and stage.enter_when:
        raise refusal(f"{key}.enter_when", stage.enter_when, "{}, since a run begins in this stage")
    if number > 0 and not stage.enter_when:
        conditions = ", ".join(STAGE_CONDITIONS)
        raise refusal(f"{key}.enter_when", stage.enter_when, f"at least one of {conditions}")
    for name, value in stage.enter_when.items():
        if name not in STAGE_CONDITIONS:
            raise refusal(f"{key}.enter_when", name, ", ".join(STAGE_CONDITIONS))
        if name == SHARE_CONDITION:
            check_within(f"{key}.enter_when.{name}", value, 0.0, 1.0)
        else:
            check_at_least(f"{key}.enter_when.{name}", value, 0.0)


def _check_weights(key: str, stage: StageSettings, settings: Settings, number: int) -> None:
    for name, weight in stage.weights.items():
        if name not in settings.reward.optimizing:
            allowed = ", ".join(settings.reward.optimizing) or "none, as reward.optimizing is empty"
            raise refusal(f"{key}.weights", name, allowed)
        check_within(f"{key}.weights.{name}", weight, 0.0, 1.0)
    if stage.weights and not has_part(settings.optimizer, STAGED):
        raise SettingError(
            f"{key}.weights are applied by no optimizer here: use optimizer=staged, with the "
            "optimizer of all other weights in it (optimizer@optimizer.inner=NAME)"
        )


def _check_episodes(key: str, stage: StageSettings, settings: Settings, number: int) -> None:
    if stage.distance_m is not None:
        check_above(f"{key}.distance_m", stage.distance_m, 0.0)
    phases = stage.start_phases
    if phases is None:
        return
    if len(phases) != 2 or not 0.0 <= phases[0] <= phases[1] <= 1.0:
        raise refusal(f"{key}.start_phases", phases, "[first, last], both from 0 to 1, in order")
    if settings.env.start_phase != "random":
        raise SettingError(
            f"{key}.start_phases needs env.start_phase=random, which is {settings.env.start_phase}"
        )
