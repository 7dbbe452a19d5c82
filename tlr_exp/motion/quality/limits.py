"""The limits of every measure, between right and wrong (docs/motions.md grounds them)."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Limit:
    """Up to ``ok`` a value is right, beyond ``fail`` wrong, between the two a warning.

    ``unit``: of the values, for print; ``at_least``: the value must not be smaller, rather than not
    larger.
    """

    ok: float
    fail: float
    unit: str
    at_least: bool = False

    def verdict(self, value: float) -> str:
        """``ok``, ``warn`` or ``fail``."""
        sign = -1.0 if self.at_least else 1.0
        if sign * value <= sign * self.ok:
            return "ok"
        return "warn" if sign * value <= sign * self.fail else "fail"


LIMITS: dict[str, Limit] = {
    "in the floor": Limit(5.0, 30.0, "mm"),
    "floating": Limit(10.0, 100.0, "mm"),
    "foot sliding": Limit(0.1, 0.5, "m/s"),
    "beyond joint limit": Limit(0.001, 0.05, "rad"),
    "joint speed": Limit(80.0, 100.0, "% of limit"),
    "joint jump": Limit(250.0, 500.0, "rad/s²"),
    "root jump": Limit(50.0, 100.0, "m/s²"),
    "root rotation jump": Limit(250.0, 500.0, "rad/s²"),
    "links in each other": Limit(10.0, 50.0, "mm"),
    # The default termination (conf/env) ends an episode at 0.8, so it can only be a warning.
    "tilt": Limit(0.8, float("inf"), "of gravity"),
    "length": Limit(1.0, 0.1, "s", at_least=True),
}
