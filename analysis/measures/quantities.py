"""Describes the metrics of a study: name in words, unit, and which way is better."""

from dataclasses import dataclass

from tlr_exp import keys
from tlr_exp.env.terms import TERMS

# What the training of an arm is judged by.
TRAINING = (keys.TRAIN_UPPER_BODY_ERROR, keys.TRAIN_LOWER_BODY_ERROR, keys.EPISODE_LENGTH)
# Errors that do not depend on how long episodes are; runs of earlier versions have none.
AT_EQUAL_AGES = (
    keys.TRAIN_UPPER_BODY_ERROR_AT_EQUAL_AGES,
    keys.TRAIN_LOWER_BODY_ERROR_AT_EQUAL_AGES,
)
# Seconds: of an iteration, of its weight search, of the evaluation in it.
ITERATION_S, WEIGHTS_S, EVALUATE_S = (
    f"{keys.TIME_PREFIX}{phase}_s" for phase in ("iteration", "weights", "evaluate")
)


@dataclass(frozen=True)
class Quantity:
    """How a metric is shown: its name in words, its unit, and which way is better."""

    name: str
    unit: str
    larger_is_better: bool

    @property
    def label(self) -> str:
        """Axis label, "Upper-body error (m)"."""
        return f"{self.name} ({self.unit})" if self.unit else self.name


QUANTITIES = {
    keys.EPISODE_LENGTH: Quantity("Episode length", "control steps", True),
    keys.TRAIN_UPPER_BODY_ERROR: Quantity("Upper-body error", "m", False),
    keys.TRAIN_LOWER_BODY_ERROR: Quantity("Lower-body error", "m", False),
    keys.TRAIN_JOINT_ERROR: Quantity("Joint error", "rad", False),
    keys.TRAIN_UPPER_BODY_ERROR_AT_EQUAL_AGES: Quantity(
        "Upper-body error at equal times since reset", "m", False
    ),
    keys.TRAIN_LOWER_BODY_ERROR_AT_EQUAL_AGES: Quantity(
        "Lower-body error at equal times since reset", "m", False
    ),
    f"{keys.EVAL_PREFIX}upper_body_error_m": Quantity("Upper-body error, evaluation", "m", False),
    f"{keys.EVAL_PREFIX}lower_body_error_m": Quantity("Lower-body error, evaluation", "m", False),
    f"{keys.EVAL_PREFIX}joint_error_rad": Quantity("Joint error, evaluation", "rad", False),
    f"{keys.EVAL_PREFIX}survival": Quantity("Survival, evaluation", "share of roll-out", True),
    keys.EVAL_SUCCESS: Quantity("Success, evaluation", "share of roll-outs", True),
    f"{keys.EVAL_PREFIX}upright": Quantity("Upright, evaluation", "share of roll-out", True),
}

# Measures of a roll-out without exploration noise, by the columns of starts.csv: how well it
# tracks, then what the robot does to track. Measures that are not here are no part of any test.
SUCCESS, COST, LATENCY = "success", "lower_layer_cost", "latency_ms"
TRACKING_OF_ROLL_OUT = {
    SUCCESS: Quantity("Success", "share of roll-outs", True),
    "survival": Quantity("Survival", "share of roll-out", True),
    "upright": Quantity("Upright", "share of roll-out", True),
    "upper_body_error_m": Quantity("Upper-body error", "m", False),
    "lower_body_error_m": Quantity("Lower-body error", "m", False),
    "upper_body_error_root_m": Quantity("Upper-body error from the pelvis", "m", False),
    "lower_body_error_root_m": Quantity("Lower-body error from the pelvis", "m", False),
    "joint_error_rad": Quantity("Joint error", "rad", False),
    "joint_velocity_error_rad_s": Quantity("Joint velocity error", "rad/s", False),
    LATENCY: Quantity("Latency", "ms", False),
}
EFFORT_OF_ROLL_OUT = {
    "torque_nm": Quantity("Torque, mean of a joint", "N m", False),
    "power_w": Quantity("Power, all joints", "W", False),
}
COST_OF_ROLL_OUT = {COST: Quantity("Lower-layer cost", "reward a second", False)}


def quantity(metric: str) -> Quantity:
    """How a metric is shown; metrics without an entry appear under their own name."""
    return QUANTITIES.get(metric, Quantity(metric, "", True))


def quantity_of_roll_out(measure: str) -> Quantity | None:
    """How a measure of a roll-out is shown; None where it is not known which way is better."""
    if measure.startswith(keys.REWARD_TERM_PREFIX):
        term = TERMS.get(measure.removeprefix(keys.REWARD_TERM_PREFIX))
        return None if term is None or not term.is_cost else Quantity(term.name, term.unit, False)
    known = TRACKING_OF_ROLL_OUT | EFFORT_OF_ROLL_OUT | COST_OF_ROLL_OUT
    return known.get(measure)
