"""The keyframe language: what it says, and what it refuses and how."""

import math

import pytest

from tlr_exp.motion.authoring.script import KeyframeError, Script, Swing, read_script
from tlr_exp.robot.g1 import G1


def read(*keyframes: str, head: str = "", solve_hand=None) -> Script:
    text = head + "\nkeyframes:\n" + "".join(f"  - {{{keyframe}}}\n" for keyframe in keyframes)
    return read_script(text, G1, solve_hand)  # pyright: ignore[reportArgumentType]


def test_times_rate_and_names():
    script = read("time_s: 0, name: stand", "time_s: 1.5, name: 2", head="fps: 30")
    assert (script.fps, script.duration_s) == (30.0, 1.5)
    assert script.names == {"stand": 0.0, "2": 1.5}


def test_unmentioned_channels_have_one_knot_with_the_default_stance():
    script = read("time_s: 0", "time_s: 1")
    assert script.knots["left_elbow_joint"] == [(0.0, 0.6)]
    assert script.knots["right_shoulder_roll_joint"] == [(0.0, -0.2)]
    assert script.knots["left_foot.y_m"] == [(0.0, 0.1185)]
    assert script.knots["right_foot.y_m"] == [(0.0, -0.1185)]
    assert script.swings == {"left": [], "right": []}


def test_channels_pass_by_keyframes_that_do_not_mention_them():
    script = read(
        "time_s: 0, pelvis: {yaw_deg: 0}", "time_s: 1", "time_s: 2, pelvis: {yaw_deg: 90}"
    )
    assert script.knots["pelvis.yaw"] == [(0.0, 0.0), (2.0, pytest.approx(math.pi / 2))]


def test_both_arms_are_written_as_the_left_one():
    script = read(
        "time_s: 0, arms_deg: {shoulder_roll: 90, shoulder_yaw: 10, shoulder_pitch: 20}",
        "time_s: 1, right_arm_deg: {shoulder_roll: 45, elbow: 30}",
    )
    left, right = "left_shoulder_{}_joint", "right_shoulder_{}_joint"
    for joint, degrees in (("roll", 90), ("yaw", 10), ("pitch", 20)):
        sign = 1 if joint == "pitch" else -1
        assert script.knots[left.format(joint)][0][1] == pytest.approx(math.radians(degrees))
        assert script.knots[right.format(joint)][0][1] == pytest.approx(
            sign * math.radians(degrees)
        )
    assert script.knots["right_shoulder_roll_joint"][1] == (1.0, pytest.approx(-math.pi / 4))
    assert script.knots["right_elbow_joint"][1] == (1.0, pytest.approx(math.pi / 6))
    assert len(script.knots["left_elbow_joint"]) == 1


def test_one_arm_overrides_both():
    script = read("time_s: 0, arms_deg: {elbow: 10}, left_arm_deg: {elbow: 20}", "time_s: 1")
    assert script.knots["left_elbow_joint"][0][1] == pytest.approx(math.radians(20))
    assert script.knots["right_elbow_joint"][0][1] == pytest.approx(math.radians(10))


def test_hand_targets_become_joint_angles_with_y_outwards():
    calls = []

    def solve(side, target, start):
        calls.append((side, target, start))
        return [0.1, 0.2, 0.3, 0.4]

    script = read("time_s: 0", "time_s: 1, hands_m: [0.3, 0.2, 0.1]", solve_hand=solve)
    start = [0.2, 0.2, 0.0, 0.6]
    mirrored = [0.2, -0.2, 0.0, 0.6]
    assert calls == [
        ("left", [0.3, 0.2, 0.1], pytest.approx(start)),
        ("right", [0.3, -0.2, 0.1], pytest.approx(mirrored)),
    ]
    assert script.knots["right_elbow_joint"][-1] == (1.0, 0.4)


def test_a_foot_stays_until_its_swing_begins():
    script = read("time_s: 0", "time_s: 1", "time_s: 3, left_foot: {x_m: 0.2, swing_s: 0.5}")
    assert script.knots["left_foot.x_m"] == [(0.0, 0.0), (2.5, 0.0), (3.0, 0.2)]
    assert script.swings["left"] == [Swing(2.5, 3.0, 0.05)]
    assert script.swings["right"] == []


def test_a_swing_takes_the_whole_interval_by_default():
    script = read("time_s: 0", "time_s: 1", "time_s: 3, left_foot: {x_m: 0.2, lift_m: 0.1}")
    assert script.swings["left"] == [Swing(1.0, 3.0, 0.1)]


def test_a_step_on_the_spot():
    script = read("time_s: 0", "time_s: 1, left_foot: {lift_m: 0.1}")
    assert script.swings["left"] == [Swing(0.0, 1.0, 0.1)]
    assert script.knots["left_foot.x_m"] == [(0.0, 0.0), (1.0, 0.0)]


def test_a_foot_named_where_it_stands_does_not_move():
    script = read("time_s: 0", "time_s: 1, left_foot: {x_m: 0.0, y_m: 0.1185}")
    assert script.swings["left"] == []


def test_a_raised_foot_moves_on_from_where_it_was_last():
    script = read(
        "time_s: 0",
        "time_s: 1, left_foot: {z_m: 0.3, pitch_deg: 10}",
        "time_s: 2",
        "time_s: 3, left_foot: {z_m: 0, pitch_deg: 0}",
    )
    assert script.swings["left"] == [Swing(0.0, 1.0, 0.0), Swing(1.0, 3.0, 0.0)]
    assert script.knots["left_foot.z_m"] == [(0.0, 0.0), (1.0, 0.3), (3.0, 0.0)]


def test_like_repeats_a_pose_and_what_is_stated_overrides_it():
    script = read(
        "time_s: 0, name: stand, pelvis: {height_m: 0.7}",
        "time_s: 1, pelvis: {height_m: 0.5}, arms_deg: {elbow: 90}, left_foot: {x_m: 0.1}",
        "time_s: 2, like: stand, arms_deg: {elbow: 45}",
    )
    assert script.knots["pelvis.height_m"] == [(0.0, 0.7), (1.0, 0.5), (2.0, 0.7)]
    assert script.knots["left_elbow_joint"][-1] == (2.0, pytest.approx(math.pi / 4))
    assert script.knots["left_foot.x_m"][-1] == (2.0, 0.0)


@pytest.mark.parametrize(
    ("keyframes", "message"),
    [
        (["time_s: 0"], "at least two"),
        (["time_s: 1", "time_s: 2"], r"keyframe 1: time_s is 1.0; the first keyframe is at 0"),
        (["time_s: 0", "time_s: 0"], r"keyframe 2: time_s is 0.0; it must come after 0.0"),
        (["time_s: 0", "name: b"], r"keyframe 2 \(b\): time_s: expected a number, got None"),
        (["time_s: 0", "time_s: yes"], "expected a number, got True"),
        (["time_s: 0", "time_s: .nan"], "expected a number, got nan"),
        (["time_s: 0", "time_s: 1, arm: 3"], "unknown key arm; allowed are time_s, name"),
        (
            ["time_s: 0", "time_s: 1, pelvis: {height: 1}"],
            "pelvis: unknown key height; allowed are height_m",
        ),
        (["time_s: 0", "time_s: 1, pelvis: 3"], "pelvis: expected keys and values, got 3"),
        (["time_s: 0", "time_s: 1, weight_on_right: 2"], r"weight_on_right is 2.0; it lies in"),
        (["time_s: 0", "time_s: 1, hands_m: [1, 2]"], r"hands_m: expected \[x, y, z\]"),
        (["time_s: 0", "time_s: 1, left_foot: {z_m: -0.1}"], "flat on the floor"),
        (["time_s: 0", "time_s: 1, left_foot: {pitch_deg: 10}"], "flat on the floor"),
        (
            ["time_s: 0", "time_s: 1, left_foot: {x_m: 0.1, swing_s: 1.5}"],
            r"swing_s is 1.5; the swing ends at 1.0 s and may begin at 0.0 s",
        ),
        (["time_s: 0, name: a", "time_s: 1, like: b"], "no earlier keyframe 'b'; .* are a"),
        (["time_s: 0, name: a", "time_s: 1, name: a"], "another keyframe of this name"),
    ],
)
def test_mistakes_are_named(keyframes, message):
    with pytest.raises(KeyframeError, match=message):
        read(*keyframes)


def test_unreachable_hand_is_named():
    def solve(side, target, start):
        raise ValueError("the left hand misses")

    with pytest.raises(KeyframeError, match="keyframe 2: left_hand_m: the left hand misses"):
        read("time_s: 0", "time_s: 1, left_hand_m: [2, 0, 0]", solve_hand=solve)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("keyframes: [", "not a YAML file"),
        ("- 1", "the file: expected keys and values"),
        ("frames: []", "unknown key frames; allowed are fps, description, keyframes"),
        ("description: none", "at least two keyframes"),
        ("fps: 0\nkeyframes: [{time_s: 0}, {time_s: 1}]", "fps is 0"),
        ("fps: !!python/object:os.system x", "not a YAML file"),
    ],
)
def test_files_that_are_no_scripts(text, message):
    with pytest.raises(KeyframeError, match=message):
        read_script(text, G1, lambda side, target, start: start)
