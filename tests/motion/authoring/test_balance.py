"""The plan of the centre of mass."""

import numpy as np
import pytest

from tlr_exp.motion.authoring.balance import (
    GRAVITY,
    ZMP_MARGIN_M,
    MassEstimate,
    Support,
    check_balance,
    load_of,
    plan_com,
    plan_height,
)
from tlr_exp.motion.feet import half_planes

HEIGHT_M = 0.7
TIMES = np.arange(151) / 50
FOOT = np.array([[-0.05, -0.03], [0.1, -0.03], [0.1, 0.03], [-0.05, 0.03]])
SIDE = np.array([0.0, 0.12])
AHEAD = np.array([0.3, 0.0])
LEFT, RIGHT = FOOT + SIDE, FOOT - SIDE


def _point_mass(frames: int = len(TIMES), **changes) -> MassEstimate:
    values = {
        "height": np.full(frames, HEIGHT_M),
        "load": np.ones(frames),
        "zmp_offset": np.zeros((frames, 2)),
        "pelvis_offset": np.zeros((frames, 3)),
        "slow": np.zeros(frames, dtype=bool),
    }
    return MassEstimate(**(values | changes))


def _support(contacts: list[str]) -> Support:
    """Support of frames named by what touches the floor: both, left, none, or both further on."""
    hulls = {
        "both": half_planes(np.concatenate([LEFT, RIGHT])),
        "left": half_planes(LEFT),
        "none": None,
        "further": half_planes(np.concatenate([LEFT, RIGHT]) + AHEAD),
    }
    centres = {
        "both": [0.025, 0.0],
        "left": [0.025, 0.12],
        "none": [0.025, 0.0],
        "further": [0.325, 0.0],
    }
    return Support(
        planes=[hulls[contact] for contact in contacts],
        target=np.array([centres[contact] for contact in contacts]),
        reach=[np.empty((0, 3)) for _ in contacts],
        flights=_flights(contacts),
    )


def _flights(contacts: list[str]) -> list[tuple[int, int]]:
    if "none" not in contacts:
        return []
    return [(contacts.index("none") - 1, len(contacts) - contacts[::-1].index("none"))]


def _zmp(com: np.ndarray) -> np.ndarray:
    """Of a point mass at constant height: c - h / g c''."""
    acceleration = np.gradient(np.gradient(com, 0.02, axis=0), 0.02, axis=0)
    return com - HEIGHT_M / GRAVITY * acceleration


def test_standing_still_is_the_plan_of_standing():
    com = plan_com(_support(["both"] * 151), _point_mass(), TIMES)
    np.testing.assert_allclose(com, np.tile([0.025, 0.0], (151, 1)), atol=1e-6)


@pytest.fixture(scope="module")
def one_legged() -> Support:
    """A second on both feet, one on the left, one on both."""
    return _support(["both"] * 50 + ["left"] * 51 + ["both"] * 50)


def test_weight_goes_to_the_standing_foot_and_the_zmp_stays_in_it(one_legged):
    com = plan_com(one_legged, _point_mass(), TIMES)
    inside = [
        -(planes[:, :2] @ point + planes[:, 2]).max()
        for planes, point in zip(one_legged.planes, _zmp(com), strict=True)
    ]
    assert min(inside) > ZMP_MARGIN_M - 2e-3
    assert com[75, 1] > 0.07
    np.testing.assert_allclose(com[[0, -1]], [[0.025, 0.0]] * 2, atol=1e-6)
    np.testing.assert_allclose(com[1] - com[0], 0, atol=1e-4)


def test_slow_frames_keep_the_mass_itself_over_the_foot(one_legged):
    slow = np.zeros(151, dtype=bool)
    slow[52:98] = True
    free = plan_com(one_legged, _point_mass(), TIMES)
    held = plan_com(one_legged, _point_mass(slow=slow), TIMES)
    assert free[52, 1] < 0.09
    assert held[52:98, 1].min() > 0.09


def test_angular_momentum_shifts_the_plan(one_legged):
    """Where the limbs move the ZMP 2 cm forwards, the mass goes 2 cm back."""
    offset = np.zeros((151, 2))
    offset[:, 0] = 0.02
    com = plan_com(one_legged, _point_mass(zmp_offset=offset), TIMES)
    assert com[75, 0] == pytest.approx(0.005, abs=2e-3)


def test_legs_limit_the_mass(one_legged):
    reach = [np.array([[0.0, 1.0, -0.11]])] * 151
    support = Support(one_legged.planes, one_legged.target, reach)
    slow = np.ones(151, dtype=bool)
    com = plan_com(support, _point_mass(slow=slow), TIMES)
    assert com[:, 1].max() < 0.1105


@pytest.fixture(scope="module")
def leap() -> Support:
    """1.2 s on both feet, 0.32 s in the air, the rest on both feet 0.3 m further."""
    return _support(["both"] * 60 + ["none"] * 15 + ["further"] * 76)


def test_flight_is_straight_and_of_constant_speed(leap):
    com = plan_com(leap, _point_mass(), TIMES)
    assert leap.flights == [(59, 75)]
    flight = com[59:76]
    line = np.linspace(flight[0], flight[-1], 17)
    np.testing.assert_allclose(flight, line, atol=1e-7)
    assert flight[-1, 0] - flight[0, 0] > 0.1
    assert com[-1, 0] - com[0, 0] == pytest.approx(0.3)


def test_feet_with_little_load_push_little_along_the_floor(leap):
    """Before take-off the load fades over 0.3 s; the push that a loaded foot gave must go too."""
    before = slice(50, 58)
    load = np.clip(np.abs(np.arange(151) - 67) / 15 - 8 / 15, 0.0, 1.0)  # 0 from 59 to 75
    pushes = [
        np.abs(np.gradient(np.gradient(com, 0.02, axis=0), 0.02, axis=0))[before].max()
        for com in (
            plan_com(leap, _point_mass(), TIMES),
            plan_com(leap, _point_mass(load=load), TIMES),
        )
    ]
    assert pushes[1] < 0.75 * pushes[0]


def test_too_fast_a_step_is_refused_with_its_time():
    support = _support(["both"] * 2 + ["left"] * 147 + ["both"] * 2)
    mass = _point_mass()
    com = np.tile([0.025, 0.0], (151, 1))
    with pytest.raises(ValueError, match=r"at 0.04 s the weight is 90 mm beside the feet"):
        check_balance(com, support, mass, TIMES)
    check_balance(com, _support(["both"] * 151), mass, TIMES)


def test_height_falls_freely_in_flight_and_keeps_to_what_is_written_elsewhere():
    written = np.full(151, 0.7)
    height, lift = plan_height(written, [(69, 85)], TIMES)
    np.testing.assert_allclose(lift[69:86], -GRAVITY, atol=1e-6)
    # Of a parabola, second differences are exact: h'' dt^2.
    np.testing.assert_allclose(np.diff(height[69:86], n=2), -GRAVITY * 0.02**2, atol=1e-9)
    np.testing.assert_allclose(height[[69, 85]], 0.7, atol=5e-3)
    # 0.32 s between take-off and landing at one height: an eighth of g t^2.
    assert height.max() - height[69] == pytest.approx(GRAVITY * 0.32**2 / 8, abs=2e-3)
    np.testing.assert_allclose(height[[0, -1]], 0.7, atol=1e-9)
    np.testing.assert_allclose(lift[[0, -1]], 0.0, atol=1e-6)


def test_feet_never_pull():
    """A drop written faster than free fall becomes one that gravity can make."""
    written = np.where(TIMES < 1.5, 0.8, 0.5)
    _, lift = plan_height(written, [], TIMES)
    assert lift.min() > -GRAVITY - 0.05
    assert load_of(np.full(151, 0.7), TIMES) == pytest.approx(1.0)
    assert load_of(0.7 + TIMES**2, TIMES)[75] == pytest.approx(1 + 2 / GRAVITY)
