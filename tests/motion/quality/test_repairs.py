"""What is repaired comes back as it was; what cannot be repaired stays, and is said."""

import numpy as np
import pytest

from tlr_exp.motion.clip import clip_from_qpos
from tlr_exp.motion.quality.check import check_clip
from tlr_exp.motion.quality.floor import floor_contacts
from tlr_exp.motion.quality.limits import LIMITS
from tlr_exp.motion.quality.repairs import repair_clip
from tlr_exp.motion.quality.smoothing import channels, mend
from tlr_exp.robot.g1 import G1

KNEE = 7 + G1.joint_names.index("left_knee_joint")
SHOULDER = 7 + G1.joint_names.index("left_shoulder_pitch_joint")


@pytest.fixture
def broken(gym_clip, robot):
    """``broken(change)``: the gym-motion's first 4 s after ``change(qpos)``."""

    def make(change):
        qpos = gym_clip.qpos[:201].copy()
        change(qpos)
        return clip_from_qpos(qpos, 50.0, robot)

    return make


def shift(qpos):
    qpos[:, 2] += 0.03


def verdicts(clip, robot):
    return {finding.measure: finding.verdict for finding in check_clip(clip, robot)}


@pytest.mark.parametrize("metres", [0.03, -0.04])
def test_a_shifted_clip_comes_back(metres, gym_clip, robot):
    qpos = gym_clip.qpos.copy()
    qpos[:, 2] += metres
    repaired = repair_clip(clip_from_qpos(qpos, 50.0, robot), robot)
    np.testing.assert_allclose(repaired.clip.qpos, gym_clip.qpos, atol=1e-4)
    np.testing.assert_allclose(repaired.clip.qvel, gym_clip.qvel, atol=1e-6)
    (change,) = repaired.changes
    assert f"moved the whole clip by {-1000 * metres:+.1f} mm" in change


def test_nothing_is_changed_in_a_good_clip(gym_clip, robot):
    repaired = repair_clip(gym_clip, robot)
    assert repaired.clip is gym_clip
    assert repaired.changes == []


def test_the_height_is_kept_if_asked(broken, robot):
    clip = broken(shift)
    assert repair_clip(clip, robot, ground="none").clip is clip
    with pytest.raises(ValueError, match="allowed are constant, varying, none"):
        repair_clip(clip, robot, ground="flat")


def test_flight_is_left_in_the_air(standing, make_clip, robot):
    """A jump, 30 mm too high: the lowest point on the floor is that of standing."""
    time = np.arange(61) / 50 - 0.4
    qpos = standing.copy()
    qpos[:, 2] += np.where(time > 0, np.maximum(1.5 * time - 9.81 * time**2 / 2, 0.0), 0.0)
    raised = qpos.copy()
    raised[:, 2] += 0.03
    repaired = repair_clip(make_clip(raised), robot, ground="varying")
    np.testing.assert_allclose(repaired.clip.qpos, qpos, atol=1e-9)


def test_a_drifting_floor_is_taken_out_only_if_asked(standing, make_clip, robot):
    drift = np.linspace(0.0, 0.06, 61)
    qpos = standing.copy()
    qpos[:, 2] += drift
    constant = repair_clip(make_clip(qpos), robot)
    assert constant.changes == []
    varying = repair_clip(make_clip(qpos), robot, ground="varying")
    assert "slowly varying" in varying.changes[0]
    assert floor_contacts(varying.clip, robot).lowest.max() < 0.012
    assert np.abs(np.diff(varying.clip.qpos[:, 2], n=2)).max() < 1e-3


def test_a_spike_comes_out_and_the_rest_stays(broken, gym_clip, robot):
    clip = broken(lambda qpos: qpos[100].__setitem__(KNEE, qpos[100, KNEE] + 0.5))
    repaired = repair_clip(clip, robot)
    np.testing.assert_allclose(repaired.clip.qpos, gym_clip.qpos[:201], atol=2e-4)
    others = np.r_[:95, 106:201]
    np.testing.assert_array_equal(repaired.clip.qpos[others], gym_clip.qpos[others])
    assert repaired.changes == [
        "left_knee_joint: bridged 1.98-2.02 s by a smooth curve, changed by at most 0.500 rad"
    ]


def test_a_step_becomes_a_smooth_way(broken, gym_clip, robot):
    clip = broken(lambda qpos: qpos[100:].__setitem__((slice(None), SHOULDER), 0.4))
    assert verdicts(clip, robot)["joint jump"] == "fail"
    repaired = repair_clip(clip, robot)
    assert verdicts(repaired.clip, robot)["joint jump"] == "ok"
    assert repaired.clip.qpos[130, SHOULDER] == 0.4
    np.testing.assert_array_equal(repaired.clip.qpos[:85], clip.qpos[:85])


def test_jumps_of_the_root_come_out(broken, gym_clip, robot):
    def jump(qpos):
        qpos[60, 0] += 0.05
        qpos[120, 3], qpos[120, 6] = np.cos(0.15), np.sin(0.15)

    repaired = repair_clip(broken(jump), robot)
    np.testing.assert_allclose(repaired.clip.qpos, gym_clip.qpos[:201], atol=1e-3)
    assert [change.split(":")[0] for change in repaired.changes] == [
        "the root's position",
        "the root's orientation",
    ]


def test_shaking_is_filtered_without_delay(robot, standing, make_clip):
    """Noise of 0.15 rad on a sine of 0.5 Hz: what is left is closer to the sine."""
    rng = np.random.default_rng(0)
    time = np.arange(201) / 50
    sine = 0.6 * np.sin(np.pi * time)
    qpos = np.tile(standing[0], (201, 1))
    qpos[:, SHOULDER] = sine + 0.15 * rng.standard_normal(201)
    repaired = repair_clip(make_clip(qpos), robot)
    assert "filtered below" in repaired.changes[0]
    assert "without delay" in repaired.changes[0]
    inside = slice(20, -20)
    after = repaired.clip.qpos[inside, SHOULDER]
    assert np.std(after - sine[inside]) < 0.7 * np.std(qpos[inside, SHOULDER] - sine[inside])
    lags = [np.std(after - np.roll(sine, lag)[inside]) for lag in range(-5, 6)]
    assert abs(int(np.argmin(lags)) - 5) <= 1


def test_no_jump_no_change():
    time = np.arange(100) / 50
    values = np.sin(3 * time)[:, None]
    after, how = mend(values, channels(G1)[-1], 50.0)
    assert how == ""
    assert after is values


def test_bad_ends_are_cut_off(broken, gym_clip, robot):
    """A first frame in another pose and three last ones: the jump and what is beyond it go."""

    def ends(qpos):
        qpos[0, SHOULDER] += 1.0
        qpos[-3:, SHOULDER] += 1.0

    repaired = repair_clip(broken(ends), robot)
    np.testing.assert_array_equal(repaired.clip.qpos, gym_clip.qpos[2:197])
    assert verdicts(repaired.clip, robot)["joint jump"] == "ok"
    assert [change.split(" frames")[0] for change in repaired.changes[:2]] == [
        "cut off the first 2",
        "cut off the last 4",
    ]


def test_joints_go_back_to_their_limits(standing, make_clip, robot):
    qpos = standing.copy()
    limit = robot.joint_range_rad[KNEE - 7, 1]
    qpos[:, KNEE] = limit + 0.03
    repaired = repair_clip(make_clip(qpos), robot)
    np.testing.assert_array_equal(repaired.clip.qpos[:, KNEE], limit)
    assert repaired.changes[0] == (
        "set left_knee_joint to its limit in 61 frames (it was up to 0.030 rad beyond)"
    )


def test_a_sliding_foot_is_left_as_it_is(standing, make_clip, robot):
    qpos = standing.copy()
    qpos[:, 1] += 0.2 * np.arange(61) / 50
    repaired = repair_clip(make_clip(qpos), robot)
    assert repaired.changes == []
    assert verdicts(repaired.clip, robot)["foot sliding"] == "warn"


def test_every_channel_of_qpos_is_covered():
    covered = np.concatenate([np.arange(30)[channel.columns] for channel in channels(G1)])
    np.testing.assert_array_equal(np.sort(covered), np.arange(30))
    assert {channel.limit for channel in channels(G1)} == {
        LIMITS[name] for name in ("root jump", "root rotation jump", "joint jump")
    }
