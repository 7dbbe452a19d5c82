"""The authored motions: what each one is, and that a real G1 could do it."""

import numpy as np
import pytest

from tlr_exp.motion.authoring.balance import GRAVITY
from tlr_exp.motion.authoring.keyframes import build_clip
from tlr_exp.motion.clips import motion_names
from tlr_exp.motion.dynamics import centroidal, inverse_dynamics
from tlr_exp.motion.quality.check import check_clip, worst_verdict
from tlr_exp.robot.g1 import G1

# gym_motion has a file of its own.
LIBRARY = ("jump", "kick", "run", "side_step", "squat", "stand", "walk", "wave")
FLYING = ("jump", "run")
# Clips are sampled at 50 Hz. Jerky moments, take-off above all, lose up to this much between the
# frames: of the same motion at 200 Hz less than a third remains (see below).
MAX_UNMET_FORCE_N, MAX_UNMET_FORCE_IN_FLIGHT_N = 10.0, 25.0


@pytest.fixture(params=LIBRARY)
def name(request) -> str:
    return request.param


@pytest.fixture
def clip(authored, name):
    return authored(name)[0]


@pytest.fixture
def place(authored):
    """Position of a body of a motion at the time of a keyframe, by its name, or at a time in s."""

    def of(motion: str, when: str | float, body: str) -> np.ndarray:
        clip, plan = authored(motion)
        time_s = plan.names[when] if isinstance(when, str) else when
        return clip.body_pos_w[round(time_s * clip.fps), G1.tracked_bodies.index(body)]

    return of


# --- what all of them hold -------------------------------------------------------------------


def test_every_authored_motion_is_tested():
    assert motion_names() == sorted((*LIBRARY, "gym_motion"))


def test_the_check_finds_nothing_wrong(clip, robot):
    findings = check_clip(clip, robot)
    assert worst_verdict(findings) in ("ok", "note"), [
        finding for finding in findings if finding.verdict not in ("ok", "note")
    ]


def test_length_is_two_to_eight_seconds_at_50_hz(clip):
    assert clip.fps == 50.0
    assert 2.0 <= clip.duration_s <= 8.0


def test_it_begins_and_ends_at_rest_in_the_default_stance(clip, authored):
    """So that motions can be joined in any order; at the end it may stand elsewhere."""
    stance = authored("stand")[0].qpos[0]
    np.testing.assert_allclose(clip.qpos[0], stance, atol=2e-3)
    np.testing.assert_allclose(clip.qpos[-1, 2:], stance[2:], atol=2e-3)
    for frame in (0, -1):
        assert np.abs(clip.qvel[frame]).max() < 0.02


def test_standing_feet_stay_flat_where_they_are(authored, name):
    clip, plan = authored(name)
    for side, path in enumerate(plan.feet):
        foot = clip.body_pos_w[:, G1.tracked_bodies.index(G1.foot_names[side])]
        edges = np.diff(np.concatenate([[0], path.on_floor, [0]]).astype(int))
        for start, end in zip(np.flatnonzero(edges > 0), np.flatnonzero(edges < 0), strict=True):
            assert np.abs(foot[start:end] - foot[start]).max() < 1e-3


def test_joints_keep_a_margin_and_motors_suffice(clip, robot):
    low, high = robot.joint_range_rad.T
    assert np.minimum(clip.qpos[:, 7:] - low, high - clip.qpos[:, 7:]).min() > 0.05 - 1e-6
    assert (np.abs(clip.qvel[:, 6:]) / robot.velocity_limit_rad_s).max() < 0.6
    effort = inverse_dynamics(clip, robot)
    assert (np.abs(effort.joint_torque) / robot.effort_limit_nm).max() < 1.0


def test_floor_gives_the_forces(clip, name, robot):
    """Beside the weight of 340 N."""
    limit = MAX_UNMET_FORCE_IN_FLIGHT_N if name in FLYING else MAX_UNMET_FORCE_N
    assert inverse_dynamics(clip, robot).unmet_force.max() < limit


# --- flight ----------------------------------------------------------------------------------


@pytest.fixture(params=FLYING)
def flying(request, authored):
    return authored(request.param)


def test_only_jump_and_run_leave_the_floor(authored, name):
    flights = authored(name)[1].flights
    assert len(flights) == {"jump": 1, "run": 5}.get(name, 0)


def test_centre_of_mass_follows_the_parabola(flying, robot):
    """Second differences of a parabola are exact: (0, 0, -g) dt^2."""
    clip, plan = flying
    com = centroidal(clip, robot).com
    for up, down in plan.flights:
        fall = np.diff(com[up : down + 1], n=2, axis=0) * clip.fps**2
        np.testing.assert_allclose(fall, np.tile([0, 0, -GRAVITY], (len(fall), 1)), atol=0.01)


def test_take_off_and_landing_are_no_blows(flying, robot):
    """A jump of velocity by 0.6 m/s within a frame would be more than 3 g."""
    clip, plan = flying
    com = centroidal(clip, robot).com
    acceleration = np.linalg.norm(np.diff(com, n=2, axis=0), axis=1) * clip.fps**2
    for frame in (frame for flight in plan.flights for frame in flight):
        assert acceleration[frame - 4 : frame + 4].max() < 2 * GRAVITY


def test_angular_momentum_is_constant_in_flight(flying, robot):
    """Within 0.01 kg m^2/s, of up to 1.8 that the same motions have on the floor."""
    clip, plan = flying
    momentum = centroidal(clip, robot).angular_momentum
    for up, down in plan.flights:
        assert np.ptp(momentum[up : down + 1], axis=0).max() < 0.01
    assert np.abs(momentum).max() > 0.9


def test_what_is_unmet_in_flight_lies_between_the_frames(robot, request):
    """Four times the frames, and what no force explains all but vanishes."""
    path = request.config.rootpath / "tlr_exp/motion/clips/jump.yaml"
    fine = build_clip("fps: 200\n" + path.read_text(encoding="utf-8"), robot)
    assert inverse_dynamics(fine, robot).unmet_force.max() < MAX_UNMET_FORCE_IN_FLIGHT_N / 3


# --- what each one shows ---------------------------------------------------------------------


def test_stand_stands(authored):
    clip, _ = authored("stand")
    assert np.ptp(clip.qpos, axis=0).max() < 1e-4


def test_squat_goes_down_twice(place):
    for low in ("low", "low again"):
        assert place("squat", low, "pelvis")[2] < place("squat", "stand", "pelvis")[2] - 0.25
    assert place("squat", "up", "pelvis")[2] == pytest.approx(
        place("squat", "stand", "pelvis")[2], abs=0.01
    )


def test_wave_swings_the_raised_right_hand(place):
    for moment in ("out", "in"):
        assert place("wave", moment, "right_hand")[2] > place("wave", moment, "torso_link")[2] + 0.3
        assert place("wave", moment, "left_hand")[2] < place("wave", moment, "torso_link")[2]
    assert place("wave", "in", "right_hand")[1] > place("wave", "out", "right_hand")[1] + 0.15


def test_kick_reaches_forwards_at_knee_height_from_behind(place):
    foot, standing = "right_ankle_roll_link", "left_ankle_roll_link"
    assert place("kick", "drawn back", foot)[0] < place("kick", "drawn back", standing)[0] - 0.05
    kicked = place("kick", "kick", foot)
    assert kicked[0] > place("kick", "kick", standing)[0] + 0.4
    assert kicked[2] > 0.3


def test_walk_goes_forwards_in_seven_steps_with_a_foot_on_the_floor(authored, place):
    _, plan = authored("walk")
    steps = sum((np.diff(foot.on_floor.astype(int)) > 0).sum() for foot in plan.feet)
    assert steps == 7
    assert place("walk", 6.2, "pelvis")[0] - place("walk", 0.0, "pelvis")[0] == pytest.approx(
        1.4, abs=0.01
    )


def test_arms_swing_against_the_legs(place):
    for motion, moment in (("walk", "right"), ("run", "run 2")):
        assert place(motion, moment, "left_hand")[0] > place(motion, moment, "right_hand")[0] + 0.1
        foot, other = (
            place(motion, moment, f"{side}_ankle_roll_link")[0] for side in ("right", "left")
        )
        assert foot > other


def test_side_step_goes_to_the_left_and_never_crosses_the_feet(authored, place):
    clip, _ = authored("side_step")
    assert place("side_step", 8.0, "pelvis")[1] == pytest.approx(0.393, abs=0.01)
    left, right = (clip.body_pos_w[:, G1.tracked_bodies.index(foot), 1] for foot in G1.foot_names)
    assert (left - right).min() > 0.15


def test_run_covers_ground_with_a_flight_in_each_step(authored, place):
    clip, plan = authored("run")
    assert place("run", 5.0, "pelvis")[0] == pytest.approx(1.33, abs=0.05)
    assert [round((down - up) / clip.fps, 2) for up, down in plan.flights] == [0.12] * 5
    assert place("run", 2.8, "pelvis")[0] - place("run", 2.08, "pelvis")[0] > 0.65 * 0.72


def test_jump_takes_both_feet_off_the_floor(authored, robot):
    clip, plan = authored("jump")
    ((up, down),) = plan.flights
    com = centroidal(clip, robot).com[:, 2]
    # From take-off to landing at one height: an eighth of g t^2.
    assert com[up : down + 1].max() - com[[up, down]].mean() == pytest.approx(
        GRAVITY * 0.24**2 / 8, abs=2e-3
    )
    feet = clip.body_pos_w[:, [G1.tracked_bodies.index(foot) for foot in G1.foot_names], 2]
    assert (feet[(up + down) // 2] - feet[0]).min() > 0.06
