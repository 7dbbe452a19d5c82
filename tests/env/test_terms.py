"""Reward terms: one number each by hand, their ranges, and parity with NumPy loops over bodies."""

import math
from dataclasses import replace

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from analysis.measures.quantities import quantity_of_roll_out
from tlr_exp import keys
from tlr_exp.config.load import ConfigError
from tlr_exp.env import terms
from tlr_exp.env.instant import Instant
from tlr_exp.env.terms import COSTS, TERMS
from tlr_exp.motion.reference import ReferenceFrame
from tlr_exp.robot.g1 import G1

GOAL_TERMS = tuple(name for name in TERMS if name not in COSTS)


def constants_of(name: str) -> dict[str, float]:
    return dict.fromkeys(TERMS[name].constants, 0.1)


def move(step, bodies: tuple[str, ...], by: tuple[float, float, float]) -> None:
    for body in bodies:
        step.state.body_pos_w[:, G1.tracked_bodies.index(body)] += torch.tensor(by)


# --- properties of every term ----------------------------------------------------------------


def test_a_term_is_stated_once_and_known_everywhere(settings_of, make_env, tracking):
    """Its function alone: configuration, environment and report have it then."""
    with pytest.raises(ConfigError, match=r"reward\.optimizing\.pushing is no reward term"):
        settings_of("+reward.optimizing.pushing=-1")

    @terms.cost("max(0, |F_z| - F_0)", "N")
    def pushing(step, *, threshold: float):
        force = step.state.foot_contact_force[..., 2].abs().sum(dim=-1)
        return (force - threshold).clamp(min=0.0)

    overrides = ("+reward.optimizing.pushing=-2", "+reward.parameters.pushing.threshold=100")
    try:
        with pytest.raises(ConfigError, match=r"pushing has \[\]; it needs \['threshold'\]"):
            settings_of(overrides[0])
        env = make_env(*overrides, "env.start_phase=zero", failures=False)
        shown = quantity_of_roll_out(keys.REWARD_TERM_PREFIX + "pushing")
    finally:
        del TERMS["pushing"]
    assert env.term_names[-1] == "pushing"
    now = env.reset()
    for _ in range(12):  # until it has come down on its feet
        after = env.step(now.set(keys.ACTION, torch.zeros(4, G1.num_joints)))["next"]
    force = env.state.foot_contact_force[..., 2].abs().sum(dim=-1)
    assert (force > 100.0).all()
    assert torch.equal(after[keys.REWARD_TERMS][:, -1], (force - 100.0).clamp(min=0.0))
    assert shown is not None
    assert (shown.name, shown.unit, shown.larger_is_better) == ("pushing", "N", False)
    # 3 N and 90 N on the feet, 93 N in all: by hand.
    step = tracking(foot_contact_force=torch.tensor([[[0.0, 5.0, 3.0], [0.0, 0.0, -90.0]]]))
    assert pushing(step, threshold=50.0).item() == 43.0


def test_what_a_term_is_called_and_takes_is_what_its_function_says():
    assert list(TERMS) == [term.function.__name__ for term in TERMS.values()]
    assert TERMS["body_pos"] is terms.body_pos
    assert (terms.body_pos.is_cost, terms.body_pos.constants) == (False, ("sigma",))
    assert (terms.torque_limits.is_cost, terms.torque_limits.constants) == (True, ("margin",))
    assert terms.torques.constants == ()
    assert COSTS[:7] == terms.PAPER_LOWER_LAYER
    assert COSTS[7:] == (
        *("torques", "termination"),
        *("dof_pos_excess", "dof_vel_excess", "torque_excess"),
        *("feet_orientation", "feet_heading", "slippage"),
    )


@pytest.mark.parametrize("name", GOAL_TERMS)
def test_perfect_tracking_is_worth_exactly_one(name, tracking):
    assert TERMS[name](tracking(3), **constants_of(name)).tolist() == [1.0] * 3


@pytest.mark.parametrize("name", COSTS)
def test_a_robot_that_stands_still_within_its_limits_costs_nothing(name, tracking):
    step = tracking(2)
    step.state.qpos[:, 7:] = 1.0
    step.state.qvel[:] = 0.0
    upright = torch.tensor([1.0, 0.0, 0.0, 0.0])
    step.state.qpos[:, 3:7] = upright
    step.state.body_quat_w[:] = upright
    assert TERMS[name](step, **constants_of(name)).tolist() == [0.0] * 2


@pytest.mark.parametrize("name", TERMS)
def test_goal_terms_lie_within_0_and_1_and_costs_are_not_negative(name, unrelated):
    result = TERMS[name](unrelated(200), **constants_of(name))
    assert result.shape == (200,)
    assert result.dtype == torch.float32
    assert result.isfinite().all()
    assert (result >= 0.0).all()
    assert result.unique().numel() > 1 or name in GOAL_TERMS
    assert (result <= 1.0).all() or name not in GOAL_TERMS


@pytest.mark.parametrize("name", TERMS)
def test_environments_do_not_mix(name, unrelated):
    """What one environment gets does not depend on its neighbours."""
    step = unrelated(6)
    whole = TERMS[name](step, **constants_of(name))
    row = torch.tensor([4])
    reference = ReferenceFrame(*(field[row] for field in step.reference))
    alone = replace(
        step,
        instant=Instant(step.state.at(row), reference, step.spec),
        action=step.action[row],
        previous_action=step.previous_action[row],
        terminated=step.terminated[row],
    )
    torch.testing.assert_close(TERMS[name](alone, **constants_of(name)), whole[4:5])


# --- the upper layer by hand -----------------------------------------------------------------


def test_body_pos_by_hand(tracking):
    # One of 27 bodies is off by (0.3, 0, -0.9) m: (0.09 + 0.81)/(3 * 27) = 1/90 m^2;
    # exp(-(1/90)/(1/30)) = exp(-1/3).
    step = tracking()
    move(step, ("left_knee_link",), by=(0.3, 0.0, -0.9))
    assert terms.body_pos(step, sigma=1 / 30).item() == pytest.approx(math.exp(-1 / 3), rel=1e-5)


def test_body_rot_by_hand(tracking):
    # Every body turned by 0.5 rad about the world's z axis: mean theta^2 = 0.25; exp(-0.25/0.5).
    step = tracking()
    turn = Rotation.from_rotvec([0.0, 0.0, 0.5])
    for body in range(27):
        start = Rotation.from_quat(step.reference.body_quat_w[0, body], scalar_first=True)
        step.state.body_quat_w[0, body] = torch.tensor((turn * start).as_quat(scalar_first=True))
    assert terms.body_rot(step, sigma=0.5).item() == pytest.approx(math.exp(-0.5), rel=1e-5)


def test_body_rot_takes_both_quaternions_of_an_orientation_for_the_same(tracking):
    step = tracking()
    step.state.body_quat_w.neg_()
    assert terms.body_rot(step, sigma=0.5).item() == 1.0


@pytest.mark.parametrize(
    ("term", "field"),
    [(terms.body_vel, "body_lin_vel_w"), (terms.body_ang_vel, "body_ang_vel_w")],
)
def test_body_velocities_by_hand(term, field, tracking):
    # Each of three bodies is off by (1, -2, 2): 9 each, summed over the axes;
    # 27/27 bodies = 1; exp(-1/4).
    step = tracking()
    getattr(step.state, field)[0, [0, 5, 26]] += torch.tensor([1.0, -2.0, 2.0])
    assert term(step, sigma=4.0).item() == pytest.approx(math.exp(-0.25), rel=1e-5)


@pytest.mark.parametrize(
    ("term", "inside", "outside", "size"),
    [
        (terms.upper_body_pos, "head", "torso_link", 11),
        (terms.lower_body_pos, "torso_link", "left_hand", 16),
        (terms.three_point_pos, "right_hand", "right_elbow_link", 3),
        (terms.feet_pos, "left_ankle_roll_link", "left_ankle_pitch_link", 2),
    ],
)
def test_body_groups_by_hand(term, inside, outside, size, tracking):
    # One body of the group is off by 0.3 m along one axis: 0.09/(3 * size);
    # sigma = 0.03/size makes it exp(-1). A body outside the group does not count.
    step = tracking()
    move(step, (outside,), by=(1.0, 1.0, 1.0))
    assert term(step, sigma=0.03 / size).item() == 1.0
    step = tracking()
    move(step, (inside,), by=(0.0, 0.3, 0.0))
    assert term(step, sigma=0.03 / size).item() == pytest.approx(math.exp(-1.0), rel=1e-4)


def test_joint_pos_by_hand(tracking):
    # Two of 23 joints are off by 0.3 and -0.4 rad: (0.09 + 0.16)/23; sigma = 0.125/23: exp(-2).
    step = tracking()
    step.state.qpos[0, 7] += 0.3
    step.state.qpos[0, 29] -= 0.4
    step.state.qpos[0, :7] += 1.0  # the root is no joint
    assert terms.joint_pos(step, sigma=0.125 / 23).item() == pytest.approx(math.exp(-2), rel=1e-4)


def test_joint_vel_by_hand(tracking):
    # One joint is off by 2 rad/s: 4/23; sigma = 8/23: exp(-1/2).
    step = tracking()
    step.state.qvel[0, 6] += 2.0
    step.state.qvel[0, :6] += 1.0
    assert terms.joint_vel(step, sigma=8 / 23).item() == pytest.approx(math.exp(-0.5), rel=1e-4)


@settings(max_examples=15)
@given(st.integers(0, 1000))
def test_upper_layer_is_a_loop_over_bodies_in_numpy(unrelated, seed):
    step = unrelated(2, seed)
    for env in range(2):
        state, reference = (
            {name: value[env].double() for name, value in both._asdict().items()}
            for both in (step.state, step.reference)
        )
        errors = {"pos": 0.0, "rot": 0.0, "vel": 0.0, "ang_vel": 0.0}
        for body in range(27):
            turn = (
                Rotation.from_quat(reference["body_quat_w"][body], scalar_first=True)
                * Rotation.from_quat(state["body_quat_w"][body], scalar_first=True).inv()
            )
            errors["rot"] += np.linalg.norm(turn.as_rotvec()) ** 2 / 27
            for name, field, divisor in (
                ("pos", "body_pos_w", 81),
                ("vel", "body_lin_vel_w", 27),
                ("ang_vel", "body_ang_vel_w", 27),
            ):
                for axis in range(3):
                    gap = reference[field][body, axis] - state[field][body, axis]
                    errors[name] += float(gap) ** 2 / divisor
        for name, error in errors.items():
            found = TERMS[f"body_{name}"](step, sigma=2.0)[env].item()
            assert found == pytest.approx(math.exp(-error / 2.0), rel=1e-4)
