"""Tables and their cells as plain text; pages lay them out."""

import math
from dataclasses import dataclass

from analysis.statistics.results import Interval, SignificanceTest

MISSING = "n/a"
NBSP = "\u00a0"  # a space at which no line is broken


@dataclass(frozen=True)
class Table:
    """Cells as text; the first column names the row.

    Attributes:
        title: a few words.
        header: names of the columns.
        rows: as many cells each as the header has.
        note: what a reader must know to read it.
    """

    title: str
    header: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    note: str = ""


def spread_text(mean: float, std: float, digits: int) -> str:
    """Mean ± standard deviation; of a single value n/a for the latter."""
    return f"{mean:.{digits}f}{NBSP}±{NBSP}{number(std, digits)}"


def p_text(test: SignificanceTest) -> str:
    """A p-value as text; n/a where the data allow none."""
    return p_value_text(test.p_value)


def interval_text(interval: Interval, digits: int, percent: bool = False) -> str:
    """An estimate with its limits in brackets; only the estimate where the data allow none."""
    scale, unit = (100.0, f"{NBSP}%") if percent else (1.0, "")
    if math.isnan(interval.estimate):
        return MISSING
    # An estimate of exactly nothing may carry the sign of -0.0.
    text = f"{scale * interval.estimate + 0.0:+.{digits}f}{unit}"
    if math.isnan(interval.low):
        return text
    return f"{text} [{scale * interval.low:+.{digits}f},{NBSP}{scale * interval.high:+.{digits}f}]"


def duration(hours: float) -> str:
    """Hours as text with a fitting unit."""
    if math.isnan(hours):
        return MISSING
    return f"{hours:.1f} h" if hours >= 1 else f"{60 * hours:.1f} min"


def p_value_text(value: float) -> str:
    """A p-value as text, small ones as powers of ten."""
    if math.isnan(value):
        return MISSING
    if value == 0:
        return "0 (below 1e-300)"  # smaller than a float can be
    return f"{value:.1e}" if value < 1e-3 else f"{value:.3f}"


def number(value: float, digits: int) -> str:
    """A number with so many decimals."""
    return MISSING if math.isnan(value) else f"{value:.{digits}f}"
