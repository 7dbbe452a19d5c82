"""What was measured on one roll-out, as a table for the terminal."""

from rich.table import Table

from tlr_exp.evaluation import EvaluationResult


def result_table(result: EvaluationResult, title: str) -> Table:
    """The result as a table for the terminal."""
    table = Table(title=title, title_justify="left")
    table.add_column("measure")
    table.add_column("value", justify="right")
    table.add_column("unit")
    unstable = f" ({result.unstable_steps} unstable steps)" if result.unstable_steps else ""
    rows = [
        ("survival", f"{100 * result.survival:.1f}", f"% of {result.duration_s:.2f} s{unstable}"),
        ("upright", f"{100 * result.upright:.1f}", "%"),
        ("upper-body error", f"{result.upper_body_error_m:.4f}", "m"),
        ("lower-body error", f"{result.lower_body_error_m:.4f}", "m"),
        ("joint error", f"{result.joint_error_rad:.4f}", "rad"),
    ]
    if result.latency_ms is None:
        rows.append(("latency", "-", result.latency_reason))
    else:
        alike = f"ms (correlation {result.latency_correlation:.2f})"
        rows.append(("latency", f"{result.latency_ms:+.1f}", alike))
    rows += [(name, f"{value:.4g}", "mean raw term") for name, value in result.terms.items()]
    for row in rows:
        table.add_row(*row)
    return table
