"""What is measured on a roll-out: what each measure is called, and how it is printed."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Measure:
    """A number of ``EvaluationResult``, as a reader sees it.

    Attributes:
        heading: of its column, in lines.
        factor: from its unit to the printed one.
        decimals: that are printed.
        in_tables: whether it is among the few that the tables of a terminal show.
    """

    heading: str
    factor: float = 1.0
    decimals: int = 4
    in_tables: bool = True

    def text(self, value: float | None) -> str:
        """The value as it is printed; a dash where there is none."""
        return "-" if value is None else f"{self.factor * value:.{self.decimals}f}"


MEASURES = {
    "survival": Measure("sur-\nvival %", 100.0, 1),
    "upright": Measure("upright\n%", 100.0, 1),
    "upper_body_error_m": Measure("upper\nbody m"),
    "lower_body_error_m": Measure("lower\nbody m"),
    "upper_body_error_root_m": Measure("upper, from\npelvis, m", in_tables=False),
    "lower_body_error_root_m": Measure("lower, from\npelvis, m", in_tables=False),
    "joint_error_rad": Measure("joints\nrad"),
    "joint_velocity_error_rad_s": Measure("joints\nrad/s", decimals=3, in_tables=False),
    "latency_ms": Measure("lag\nms", decimals=1),
    "torque_nm": Measure("torque\nN m", decimals=2, in_tables=False),
    "power_w": Measure("power\nW", decimals=1, in_tables=False),
    "goal_reward_per_s": Measure("upper\nlayer", in_tables=False),
    "lower_layer_cost_per_s": Measure("lower\nlayer"),
}
SHOWN = {name: measure for name, measure in MEASURES.items() if measure.in_tables}
