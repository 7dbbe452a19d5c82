"""What the metrics of a study are: name in words, unit, and which way is better."""

from dataclasses import dataclass

from tlr_exp import keys

# What the training of an arm is judged by.
TRAINING = (keys.TRAIN_UPPER_BODY_ERROR, keys.TRAIN_LOWER_BODY_ERROR, keys.EPISODE_LENGTH)


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
    f"{keys.EVAL_PREFIX}upper_body_error_m": Quantity("Upper-body error, evaluation", "m", False),
    f"{keys.EVAL_PREFIX}lower_body_error_m": Quantity("Lower-body error, evaluation", "m", False),
    f"{keys.EVAL_PREFIX}joint_error_rad": Quantity("Joint error, evaluation", "rad", False),
    f"{keys.EVAL_PREFIX}survival": Quantity("Survival, evaluation", "share of roll-out", True),
    keys.EVAL_SUCCESS: Quantity("Success, evaluation", "share of roll-outs", True),
    f"{keys.EVAL_PREFIX}upright": Quantity("Upright, evaluation", "share of roll-out", True),
}


def quantity(metric: str) -> Quantity:
    """How a metric is shown; metrics without an entry appear under their own name."""
    return QUANTITIES.get(metric, Quantity(metric, "", True))
