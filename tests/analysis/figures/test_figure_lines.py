"""Curves, bands and labels of figures over training, against hand arithmetic."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from analysis.figures import lines
from analysis.figures.series import Series
from analysis.figures.style import arm_looks, new_figure

LOOK = arm_looks(["gwo"])["gwo"]


def test_moving_average_by_hand():
    values = np.array([1.0, 2.0, 6.0, 3.0])
    assert lines.moving_average(values, 3) == pytest.approx([1.5, 3.0, 11 / 3, 4.5])
    assert lines.moving_average(values, 1) == pytest.approx(values)


@given(st.lists(st.floats(-10, 10), min_size=1, max_size=30), st.integers(0, 20))
def test_moving_average_stays_within_the_values(values, half):
    smooth = lines.moving_average(np.array(values), 2 * half + 1)
    assert smooth.min() >= min(values) - 1e-9
    assert smooth.max() <= max(values) + 1e-9


def test_mean_and_band_by_hand():
    """Seeds 1, 3 and 5, 5: means 3 and 5, standard deviations (n - 1) 2 sqrt(2) and 0."""
    _, axes = new_figure(2, 2)
    series = Series(np.array([0, 1]), np.array([1, 2]), np.array([[1.0, 5.0], [5.0, 5.0]]))
    line = lines.draw_mean_and_band(axes[0, 0], series, LOOK, 0, 1)
    assert line.get_ydata() == pytest.approx([3.0, 5.0])
    (band,) = axes[0, 0].collections
    (path,) = band.get_paths()
    at_first = path.vertices[path.vertices[:, 0] == 1, 1]
    assert at_first.min() == pytest.approx(3 - 2 * np.sqrt(2))
    assert at_first.max() == pytest.approx(3 + 2 * np.sqrt(2))


def test_a_band_with_a_floor_ends_at_the_smallest_seed():
    _, axes = new_figure(2, 2)
    series = Series(np.array([0, 1]), np.array([1]), np.array([[1.0], [5.0]]))
    lines.draw_mean_and_band(axes[0, 0], series, LOOK, 0, 1, floor=True)
    (path,) = axes[0, 0].collections[0].get_paths()
    assert path.vertices[:, 1].min() == pytest.approx(1.0)


def test_one_seed_has_no_band():
    _, axes = new_figure(2, 2)
    series = Series(np.array([0]), np.array([1, 2]), np.array([[1.0, 5.0]]))
    lines.draw_mean_and_band(axes[0, 0], series, LOOK, 0, 1)
    assert len(axes[0, 0].collections) == 0


@given(st.lists(st.floats(0, 1), min_size=1, max_size=8), st.floats(0.01, 0.3))
def test_labels_are_spread_in_order_and_around_their_wishes(wanted, gap):
    places = lines.spread(wanted, gap)
    by_wish = [place for _, place in sorted(zip(wanted, places, strict=True))]
    assert all(b - a >= gap - 1e-9 for a, b in pairwise(by_wish))
    assert np.mean(places) == pytest.approx(np.mean(wanted))


def test_labels_that_fit_stay():
    assert lines.spread([0.9, 0.1], 0.2) == [0.9, 0.1]
    assert lines.spread([0.5, 0.5], 0.2) == pytest.approx([0.4, 0.6])


@pytest.mark.parametrize(("length", "count"), [(1, 1), (5, 5), (24, 8), (407, 7), (2500, 7)])
def test_markers_of_short_and_long_curves(length, count):
    start, step = lines.mark_places(length, 0, 1)
    assert len(range(start, length, step)) in (count - 1, count, count + 1)


def test_markers_of_arms_are_not_on_top_of_each_other():
    starts = {lines.mark_places(400, place, 3)[0] for place in range(3)}
    assert len(starts) == 3


def test_log_axis_has_plain_numbers():
    figure, axes = new_figure(3, 2)
    axes[0, 0].plot([0, 1], [0.015, 0.4])
    lines.plain_log_axis(axes[0, 0])
    figure.canvas.draw()
    labels = [tick.get_text() for tick in axes[0, 0].get_yticklabels()]
    assert {"0.02", "0.05", "0.1", "0.2"} <= set(labels)
