"""How numbers are written."""

import math

import pytest

from analysis.report.cells import interval_text, p_value_text
from analysis.statistics.results import Interval


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (math.nan, "n/a"),
        (0.0, "0 (below 1e-300)"),
        (1e-310, "1.0e-310"),
        (0.00099, "9.9e-04"),
        (0.001, "0.001"),
        (1.0, "1.000"),
    ],
)
def test_p_values(value: float, text: str) -> None:
    assert p_value_text(value) == text


def test_nothing_has_no_minus_but_a_limit_below_zero_has() -> None:
    """-0.004 to 2 decimals is written -0.00: the sign says that zero lies inside."""
    found = interval_text(Interval(-0.0, -0.004, 0.004, 0.95, "Welch t"), 2)
    assert found == "+0.00 [-0.00,\u00a0+0.00]"
