"""The delay of a motion behind its reference: known delays, and what has none."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tlr_exp.evaluation.latency import latency

DT = 0.02


def joint_motion(time_s: np.ndarray) -> np.ndarray:
    """Three joints that move smoothly and without a period within the delays looked for."""
    return np.stack(
        [
            np.sin(1.9 * time_s) + 0.3 * np.sin(4.1 * time_s + 1.0),
            0.5 * np.cos(2.7 * time_s) + 0.1 * time_s,
            0.2 * np.sin(3.3 * time_s + 0.5),
        ],
        axis=1,
    )


@pytest.mark.parametrize("delay_s", [0.0, 0.02, 0.06, 0.3, -0.04, 0.013, 0.047, -0.009])
def test_latency_finds_a_known_delay(delay_s):
    time_s = np.arange(400) * DT
    found = latency(joint_motion(time_s), joint_motion(time_s - delay_s), DT)
    assert found.ms == pytest.approx(1000 * delay_s, abs=0.5)
    assert found.correlation == pytest.approx(1.0, abs=2e-3)
    assert found.reason == ""


@settings(deadline=None, max_examples=30)
@given(st.floats(-0.3, 0.3), st.floats(0.05, 20.0), st.floats(-3.0, 3.0))
def test_latency_ignores_gain_and_offset_of_the_motion(delay_s, gain, offset):
    time_s = np.arange(400) * DT
    found = latency(joint_motion(time_s), gain * joint_motion(time_s - delay_s) + offset, DT)
    assert found.ms == pytest.approx(1000 * delay_s, abs=0.5)


def test_latency_changes_sign_when_reference_and_motion_change_places():
    time_s = np.arange(300) * DT
    early, late = joint_motion(time_s), joint_motion(time_s - 0.05)
    assert latency(early, late, DT).ms == pytest.approx(-latency(late, early, DT).ms, abs=1e-6)


def test_latency_is_that_of_the_joints_that_move():
    time_s = np.arange(300) * DT
    reference, motion = joint_motion(time_s), joint_motion(time_s - 0.04)
    noise = 1e-4 * np.random.default_rng(0).standard_normal((300, 20))
    found = latency(np.hstack((reference, noise)), np.hstack((motion, noise[::-1])), DT)
    assert found.ms == pytest.approx(40.0, abs=0.5)


def test_no_latency_of_a_constant_motion():
    time_s = np.arange(300) * DT
    moving, still = joint_motion(time_s), np.ones((300, 3))
    for reference, motion in ((still, still), (moving, still), (still, moving)):
        found = latency(reference, motion, DT)
        assert found.ms is None
        assert "no joint moves" in found.reason


def test_no_latency_of_unlike_motions():
    rng = np.random.default_rng(0)
    found = latency(rng.standard_normal((400, 3)), rng.standard_normal((400, 3)), DT)
    assert found.ms is None
    assert "correlation" in found.reason


def test_no_latency_beyond_the_longest_delay_looked_for():
    time_s = np.arange(400) * DT
    slow = np.stack([np.sin(0.7 * time_s), np.cos(0.5 * time_s)], axis=1)
    slow_late = np.stack([np.sin(0.7 * (time_s - 0.9)), np.cos(0.5 * (time_s - 0.9))], axis=1)
    found = latency(slow, slow_late, DT)
    assert found.ms is None
    assert "no delay within" in found.reason


def test_no_latency_of_a_short_motion():
    found = latency(joint_motion(np.arange(20) * DT), joint_motion(np.arange(20) * DT), DT)
    assert found.ms is None
    assert "shorter" in found.reason
