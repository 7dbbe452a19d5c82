"""The curves between keyframes: through the knots, smooth, and never beyond them."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tlr_exp.motion.authoring.splines import bump, interpolate

knot_lists = st.lists(
    st.tuples(st.floats(0.1, 2.0), st.floats(-1.0, 1.0)), min_size=2, max_size=8
).map(lambda steps: [(sum(s[0] for s in steps[: i + 1]), v) for i, (_, v) in enumerate(steps)])


def test_one_knot_is_a_constant():
    np.testing.assert_array_equal(interpolate([(0.0, 0.3)], np.linspace(0, 1, 5)), 0.3)


def test_two_knots_are_a_minimum_jerk_movement():
    """10 s^3 - 15 s^4 + 6 s^5, half way at half time, 0.103515625 at a quarter."""
    curve = interpolate([(1.0, 0.0), (3.0, 2.0)], np.array([0.0, 1.0, 1.5, 2.0, 3.0, 9.0]))
    np.testing.assert_allclose(curve, [0.0, 0.0, 2 * 0.103515625, 1.0, 2.0, 2.0], atol=1e-12)


def test_a_channel_passes_through_a_knot_on_its_way():
    """Slopes 1 and 3: the harmonic mean is 1.5."""
    times = np.array([1.0 - 1e-5, 1.0 + 1e-5])
    low, high = interpolate([(0.0, 0.0), (1.0, 1.0), (2.0, 4.0)], times)
    assert (high - low) / 2e-5 == pytest.approx(1.5, rel=1e-4)


def test_a_channel_rests_where_it_turns():
    times = np.array([1.0 - 1e-4, 1.0, 1.0 + 1e-4])
    values = interpolate([(0.0, 0.0), (1.0, 1.0), (2.0, 0.5)], times)
    np.testing.assert_allclose(values, 1.0, atol=1e-9)


@given(knot_lists)
def test_curves_meet_their_knots_and_stay_between_them(knots):
    times, values = np.array(knots).T
    np.testing.assert_allclose(interpolate(knots, times), values, atol=1e-9)
    for (start, low), (end, high) in pairwise(knots):
        inside = interpolate(knots, np.linspace(start, end, 50))
        assert inside.min() >= min(low, high) - 1e-9
        assert inside.max() <= max(low, high) + 1e-9


@given(knot_lists)
def test_acceleration_vanishes_at_the_knots(knots):
    """So that it does not jump there; a cubic's would be of the order of 6 D / T^2."""
    step = 1e-3
    for (start, low), (end, high) in pairwise(knots):
        inside = interpolate(knots, start + step * np.arange(3))
        acceleration = abs(inside @ [1, -2, 1]) / step**2
        # The jerk of these quintics is at most 132 D / T^3.
        assert acceleration <= step * 132 * abs(high - low) / (end - start) ** 3 + 1e-6


def test_bump_rises_to_one_and_leaves_the_floor_smoothly():
    times = np.linspace(0, 3, 3001)
    rise = bump(1.0, 2.0, times)
    assert rise.max() == pytest.approx(1.0)
    assert times[rise.argmax()] == pytest.approx(1.5)
    assert (rise[times <= 1.0] == 0).all()
    assert (rise[times >= 2.0] == 0).all()
    # t^3 near the ends: 64 * 0.001^3 one millisecond after the start.
    assert rise[1001] == pytest.approx(64e-9, rel=0.01)
