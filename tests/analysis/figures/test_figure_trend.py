"""The figure of a swept number against hand arithmetic."""

import numpy as np
import pytest
from hand_values import flat_study, line_of, texts_of, with_values
from scipy import stats
from studies import make_study

from analysis.figures.drawing import NotDrawnError
from analysis.figures.trend import figure_trend
from tlr_exp import keys

LAYERED = "two-layered (GWO)"
ARMS = ("fixed", "gwo, threshold_share=0.5", "gwo, threshold_share=0.02")


@pytest.fixture(scope="module")
def by_hand():
    given = {ARMS[1]: [[1.0], [3.0]], ARMS[2]: [[5.0], [9.0]], "fixed": [[2.0], [2.5]]}
    return figure_trend(with_values(flat_study(ARMS), keys.TRAIN_UPPER_BODY_ERROR, **given))


def test_means_stand_at_their_values(by_hand):
    at, means = line_of(by_hand.figure.axes[0], LAYERED)
    assert at.tolist() == [0.02, 0.5]
    assert means.tolist() == [7.0, 2.0]


def test_whiskers_are_student_intervals(by_hand):
    """Of 1 and 3: 2 ± t(0.975, 1 degree of freedom) * sqrt(2) / sqrt(2)."""
    half = stats.t.ppf(0.975, 1)
    whiskers = [
        line.get_data() for line in by_hand.figure.axes[0].lines if len(line.get_xdata()) == 2
    ]
    found = [tuple(y) for x, y in whiskers if tuple(x) == (0.5, 0.5) and min(y) < 0]
    assert found == [pytest.approx((2 - half, 2 + half))]


def test_the_arm_without_the_setting_is_horizontal(by_hand):
    heights = {
        line.get_ydata()[0]
        for line in by_hand.figure.axes[0].lines
        if list(line.get_xdata()) == [0, 1]
    }
    assert heights == {2.25}
    assert "Horizontal: " in by_hand.caption


def test_ticks_are_the_values_and_the_axis_is_logarithmic(by_hand):
    by_hand.figure.canvas.draw()
    panel = by_hand.figure.axes[0]
    assert [label.get_text() for label in panel.get_xticklabels()] == ["0.02", "0.5"]
    assert panel.get_xscale() == "log"
    assert "reward.objective.threshold_share" in texts_of(by_hand.figure)


def test_values_close_together_have_a_linear_axis():
    study = flat_study(["gwo, pack_size=10", "gwo, pack_size=30"])
    assert figure_trend(study).figure.axes[0].get_xscale() == "linear"


def test_methods_stand_side_by_side():
    arms = [f"{m}, threshold_share={v}" for m in ("gwo", "random") for v in (0.1, 0.3)]
    panel = figure_trend(make_study(np.random.default_rng(0), arms, [0, 1], 10)).figure.axes[0]
    left, right = (line_of(panel, name)[0] for name in (LAYERED, "random weights"))
    assert (left < right).all()
    assert np.abs(left - right).max() < 0.02


def test_methods_alone_have_no_trend():
    with pytest.raises(NotDrawnError, match="do not differ in one number"):
        figure_trend(flat_study())
