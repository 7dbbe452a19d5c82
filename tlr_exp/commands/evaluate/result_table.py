"""The measures of one roll-out as a table for the terminal."""

from rich.table import Table

from tlr_exp.evaluation.result import EvaluationResult
from tlr_exp.keys import Ending

ENDINGS = {
    Ending.COMPLETED: "-",
    Ending.FELL: "a fall",
    Ending.TOO_FAR: "a body too far off",
    Ending.UNSTABLE: "an unstable simulation",
}


def result_table(result: EvaluationResult, title: str) -> Table:
    """The result as a table for the terminal."""
    table = Table(title=title, title_justify="left")
    table.add_column("measure")
    table.add_column("value", justify="right")
    table.add_column("unit")
    unstable = f" ({result.unstable_steps} unstable steps)" if result.unstable_steps else ""
    root = "m, as seen from the pelvis"
    rows = [
        ("survival", f"{100 * result.survival:.1f}", f"% of {result.duration_s:.2f} s{unstable}"),
        ("upright", f"{100 * result.upright:.1f}", "%"),
        ("training would have ended it by", ENDINGS[result.ended_by], ""),
        ("upper-body error", f"{result.upper_body_error_m:.4f}", "m"),
        ("lower-body error", f"{result.lower_body_error_m:.4f}", "m"),
        ("upper-body error", f"{result.upper_body_error_root_m:.4f}", root),
        ("lower-body error", f"{result.lower_body_error_root_m:.4f}", root),
        ("joint error", f"{result.joint_error_rad:.4f}", "rad"),
        ("joint velocity error", f"{result.joint_velocity_error_rad_s:.3f}", "rad/s"),
        _latency(result),
        ("torque", f"{result.torque_nm:.2f}", "N m, mean of a joint"),
        ("power", f"{result.power_w:.1f}", "W, all joints"),
        ("upper layer", f"{result.goal_reward_per_s:.3f}", "reward per second"),
        ("lower layer", f"{result.lower_layer_cost_per_s:.4f}", "cost per second at weights 1"),
        *((name, f"{value:.4g}", "mean raw term") for name, value in result.terms.items()),
    ]
    for row in rows:
        table.add_row(*row)
    return table


def _latency(result: EvaluationResult) -> tuple[str, str, str]:
    if result.latency_ms is None:
        return ("latency", "-", result.latency_reason)
    alike = f"ms (correlation {result.latency_correlation:.2f})"
    return ("latency", f"{result.latency_ms:+.1f}", alike)
