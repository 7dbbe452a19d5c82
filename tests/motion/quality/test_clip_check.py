"""Every measure on a clip that has one known fault; the gym-motion has none."""

from pathlib import Path

import numpy as np
import pytest

from tlr_exp.motion.importers.convert import import_motion
from tlr_exp.motion.quality.check import check_clip, worst_verdict
from tlr_exp.motion.quality.jumps import accelerations
from tlr_exp.motion.quality.limits import LIMITS, Limit
from tlr_exp.robot.g1 import G1

MOTIONS = Path(__file__).parents[4] / "shared" / "motions"
GRAVITY = 9.81


@pytest.fixture
def found(robot, make_clip):
    """``found(qpos)``: the findings of a clip by measure."""

    def check(qpos: np.ndarray) -> dict:
        return {finding.measure: finding for finding in check_clip(make_clip(qpos), robot)}

    return check


def column(joint: str) -> int:
    return 7 + G1.joint_names.index(f"{joint}_joint")


def bad(findings: dict) -> set[str]:
    return {measure for measure, finding in findings.items() if finding.verdict in ("warn", "fail")}


def test_standing_is_right(found, standing):
    findings = found(standing)
    assert bad(findings) == set()
    assert set(findings) == {*LIMITS, "end and start apart"}
    assert findings["in the floor"].value == pytest.approx(0.0, abs=1e-9)


def test_the_gym_motion_is_right(gym_clip, robot):
    assert worst_verdict(check_clip(gym_clip, robot)) == "note"


@pytest.mark.parametrize(("millimetres", "verdict"), [(3, "ok"), (20, "warn"), (31, "fail")])
def test_a_clip_in_the_floor(found, standing, millimetres, verdict):
    standing = standing.copy()
    standing[:, 2] -= millimetres / 1000
    finding = found(standing)["in the floor"]
    assert finding.value == pytest.approx(millimetres)
    assert finding.verdict == verdict
    assert "ankle_roll" in finding.place
    assert finding.frames == (0 if verdict == "ok" else 61)


@pytest.mark.parametrize(("millimetres", "verdict"), [(9, "ok"), (30, "warn"), (101, "fail")])
def test_a_clip_over_the_floor(found, standing, millimetres, verdict):
    standing = standing.copy()
    standing[:, 2] += millimetres / 1000
    findings = found(standing)
    assert findings["floating"].value == pytest.approx(millimetres)
    assert bad(findings) == ({"floating"} if verdict != "ok" else set())
    assert findings["floating"].verdict == verdict


def flight(standing: np.ndarray, gravity: float) -> tuple[np.ndarray, float]:
    """0.4 s standing, a jump with 1.5 m/s, standing again; and its height in metres."""
    time = np.arange(len(standing)) / 50 - 0.4
    rise = 1.5 * time - gravity * time**2 / 2
    qpos = standing.copy()
    qpos[:, 2] += np.where(time > 0, np.maximum(rise, 0.0), 0.0)
    return qpos, float(rise.max())


def test_ballistic_flight_is_not_floating(found, standing):
    qpos, height = flight(standing, GRAVITY)
    finding = found(qpos)["floating"]
    assert height > 0.11
    assert finding.verdict == "ok"
    assert finding.value < 10
    assert "of free flight not counted" in finding.remark


def test_a_jump_that_falls_too_slowly_floats(found, standing):
    qpos, height = flight(standing, GRAVITY / 2)
    finding = found(qpos)["floating"]
    assert finding.verdict == "fail"
    assert finding.value == pytest.approx(1000 * height)


def test_a_sliding_foot(found, standing):
    """The whole robot moves at 0.2 m/s with both feet on the floor, for 1.2 s: 244 mm."""
    qpos = standing.copy()
    qpos[:, 1] += 0.2 * np.arange(len(qpos)) / 50
    findings = found(qpos)
    assert findings["foot sliding"].value == pytest.approx(0.2)
    assert findings["foot sliding"].remark == "slides 244 mm in 1.22 s"
    assert bad(findings) == {"foot sliding"}


def test_a_turning_foot_slides_as_its_edge_moves(found, standing):
    """Turning at 1 rad/s about the pelvis; a sole is about 0.12 m beside it."""
    qpos = standing.copy()
    angle = np.arange(len(qpos)) / 50
    qpos[:, 3], qpos[:, 6] = np.cos(angle / 2), np.sin(angle / 2)
    assert 0.1 < found(qpos)["foot sliding"].value < 0.2


def test_a_spike_in_one_frame(found, standing):
    """0.5 rad off in one frame of 0.02 s: 2 x 0.5 / 0.02^2 = 2500 rad/s^2, and 25 of 37 rad/s."""
    qpos = standing.copy()
    qpos[20, column("left_elbow")] += 0.5
    findings = found(qpos)
    assert findings["joint jump"].value == pytest.approx(2500)
    assert findings["joint jump"].time_s == pytest.approx(0.4)
    assert findings["joint jump"].place == "left_elbow_joint"
    assert findings["joint jump"].verdict == "fail"
    assert findings["joint speed"].value == pytest.approx(100 * 25 / 37)


def test_jumps_of_the_root(found, standing):
    """2 x 0.05 m / 0.02^2 = 250 m/s^2; 2 x 0.3 rad / 0.02^2 = 1500 rad/s^2."""
    qpos = standing.copy()
    qpos[20, 0] += 0.05
    qpos[40, 3], qpos[40, 6] = np.cos(0.15), np.sin(0.15)
    findings = found(qpos)
    assert findings["root jump"].value == pytest.approx(250)
    assert findings["root rotation jump"].value == pytest.approx(1500)
    assert findings["root rotation jump"].time_s == pytest.approx(0.8)


def test_a_steady_turn_does_not_jump():
    angle = 3.0 * np.arange(10) / 50
    qpos = np.zeros((10, 30))
    qpos[:, 3], qpos[:, 5] = np.cos(angle / 2), np.sin(angle / 2)
    assert accelerations(qpos, 50.0)[1].max() < 1e-9


def test_joints_beyond_their_limits(found, standing, robot):
    qpos = standing.copy()
    knee = column("right_knee")
    qpos[:, knee] = robot.joint_range_rad[knee - 7, 1] + 0.03
    finding = found(qpos)["beyond joint limit"]
    assert finding.value == pytest.approx(0.03)
    assert finding.verdict == "warn"
    assert finding.place == "right_knee_joint"


def test_a_joint_that_is_too_fast(found, standing):
    """A hip yaw at 1.1 times its 32 rad/s for three frames."""
    qpos = standing.copy()
    yaw = column("left_hip_yaw")
    qpos[:, yaw] += np.clip(np.arange(61) - 30, 0, 3) * 1.1 * 32 / 50
    finding = found(qpos)["joint speed"]
    assert finding.value == pytest.approx(110)
    assert finding.verdict == "fail"
    assert finding.frames == 3


def test_a_hand_in_the_hip(found, standing):
    qpos = standing.copy()
    qpos[:, column("left_shoulder_roll")] = -0.5
    qpos[:, column("left_elbow")] = 1.2
    finding = found(qpos)["links in each other"]
    assert finding.value > 10
    assert "left_" in finding.place


def test_a_fallen_robot_tilts(found, standing):
    """Pitched by 60 degrees; a pitch of 90 puts all of gravity into x."""
    qpos = standing.copy()
    qpos[:, 3], qpos[:, 5] = np.cos(np.pi / 6), np.sin(np.pi / 6)
    finding = found(qpos)["tilt"]
    assert finding.value == pytest.approx(np.sin(np.pi / 3))
    assert finding.verdict == "warn"


@pytest.mark.parametrize(
    ("frames", "verdict"), [(51, "ok"), (50, "warn"), (5, "fail"), (2, "fail")]
)
def test_short_clips(found, standing, frames, verdict):
    finding = found(standing[:frames])["length"]
    assert finding.value == pytest.approx((frames - 1) / 50)
    assert finding.verdict == verdict


def test_where_it_ends_is_a_note(found, standing):
    qpos = standing.copy()
    qpos[:, 0] += np.linspace(0, 0.5, 61)
    qpos[:, column("left_elbow")] += np.linspace(0, 0.3, 61)
    finding = found(qpos)["end and start apart"]
    assert (finding.value, finding.verdict) == (pytest.approx(0.3), "note")
    assert finding.remark == "pelvis 0.50 m, 0°"


def test_verdicts_at_the_limits():
    upper, lower = Limit(1.0, 2.0, "m"), Limit(2.0, 1.0, "s", at_least=True)
    assert [upper.verdict(v) for v in (0, 1, 1.5, 2, 2.1)] == ["ok", "ok", "warn", "warn", "fail"]
    assert [lower.verdict(v) for v in (3, 2, 1.5, 1, 0.9)] == ["ok", "ok", "warn", "warn", "fail"]


@pytest.mark.skipif(not MOTIONS.is_dir(), reason="the clips of ASAP are not here")
@pytest.mark.parametrize(
    ("name", "low_mm", "high_mm"),
    [("asap_cr7_level1", 100, 125), ("asap_walk_level1", 65, 80), ("asap_apt_level2", 70, 85)],
)
def test_retargeted_clips_float(name, low_mm, high_mm, robot):
    clip = import_motion(MOTIONS / f"{name}.pkl", robot).clip
    findings = {finding.measure: finding for finding in check_clip(clip, robot)}
    assert low_mm < findings["floating"].value < high_mm
    assert findings["joint speed"].verdict == findings["joint jump"].verdict == "ok"
    if "cr7" in name:  # the jump with half a turn
        assert "of free flight not counted" in findings["floating"].remark
