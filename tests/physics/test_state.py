"""The pure pieces that the engines share."""

import numpy as np
import pytest
import torch

from tlr_exp.physics.state import (
    body_twist,
    check_joint_target,
    check_reset,
    check_saved_state,
)
from tlr_exp.robot.g1 import G1


def test_twist_of_a_body_on_a_turning_arm_by_hand() -> None:
    # A tree turns at 2 rad/s about z through its centre of mass at (1, 0, 0), which moves at
    # 0.5 m/s along y. The body's origin lies 3 m further along x: 2 rad/s x 3 m = 6 m/s along y.
    cvel = np.array([[[0.0, 0.0, 2.0, 0.0, 0.5, 0.0]]])
    position = np.array([[[4.0, 0.0, 0.0]]])
    linear, angular = body_twist(cvel, position, np.array([[1.0, 0.0, 0.0]]))
    assert linear.tolist() == [[[0.0, 6.5, 0.0]]]
    assert angular.tolist() == [[[0.0, 0.0, 2.0]]]


def test_twist_is_that_of_a_rigid_body() -> None:
    """Each robot's twist is taken about its own centre of mass, as NumPy's cross product has it."""
    generator = np.random.default_rng(0)
    cvel, position = generator.normal(size=(4, 5, 6)), generator.normal(size=(4, 5, 3))
    com = generator.normal(size=(4, 3))
    linear, angular = body_twist(cvel, position, com)
    expected = cvel[..., 3:] + np.cross(cvel[..., :3], position - com[:, None])
    np.testing.assert_allclose(linear, expected, atol=1e-5)
    np.testing.assert_allclose(angular, cvel[..., :3], atol=1e-6)


def test_joint_target_of_the_wrong_shape_is_refused() -> None:
    with pytest.raises(ValueError, match=r"\[3, 22\]; expected \[3, 23\]"):
        check_joint_target(torch.zeros(3, 22), 3, G1)


@pytest.mark.parametrize("value", [float("nan"), float("inf")])
def test_joint_target_that_is_not_finite_names_the_environments(value: float) -> None:
    target = torch.zeros(5, 23)
    target[1, 4] = target[3, 0] = value
    with pytest.raises(ValueError, match=r"2 of 5 environments: \[1, 3\]"):
        check_joint_target(target, 5, G1)


@pytest.mark.parametrize(
    ("env_ids", "message"),
    [
        (torch.tensor([0, 4]), "0..3, got 0..4"),
        (torch.tensor([-1, 2]), "0..3, got -1..2"),
        (torch.tensor([2, 2]), "more than once"),
        (torch.tensor([0.0, 1.0]), "vector of integers"),
        (torch.tensor([True, False]), "vector of integers"),
        (torch.tensor([[0, 1]]), "vector of integers"),
    ],
)
def test_reset_of_environments_that_do_not_exist_is_refused(
    env_ids: torch.Tensor, message: str
) -> None:
    with pytest.raises(ValueError, match=message):
        check_reset(env_ids, torch.zeros(2, 30), torch.zeros(2, 29), 4, G1)


def test_reset_to_a_state_of_the_wrong_shape_or_not_finite_is_refused() -> None:
    env_ids = torch.tensor([0, 2])
    with pytest.raises(ValueError, match=r"qpos has the shape \[2, 29\]; expected \[2, 30\]"):
        check_reset(env_ids, torch.zeros(2, 29), torch.zeros(2, 29), 4, G1)
    qvel = torch.zeros(2, 29)
    qvel[1, 3] = torch.nan
    with pytest.raises(ValueError, match="qvel holds values that are not finite"):
        check_reset(env_ids, torch.zeros(2, 30), qvel, 4, G1)


def test_reset_of_no_environment_is_allowed() -> None:
    check_reset(torch.empty(0, dtype=torch.int64), torch.zeros(0, 30), torch.zeros(0, 29), 4, G1)


@pytest.mark.parametrize(
    ("saved", "message"),
    [
        ({"qpos": (4, 30)}, "holds qpos, this engine needs qpos, qvel: .* another engine"),
        ({"qpos": (8, 30), "qvel": (8, 29)}, "8 environments, this one has 4; .*num_envs=8"),
        ({"qpos": (4, 36), "qvel": (4, 29)}, r"\[4, 36\], this model's has \[4, 30\]"),
    ],
)
def test_saved_state_that_does_not_fit_is_refused(
    saved: dict[str, tuple[int, ...]], message: str
) -> None:
    own = {"qpos": (4, 30), "qvel": (4, 29)}
    check_saved_state({name: torch.zeros(shape) for name, shape in own.items()}, own)
    with pytest.raises(ValueError, match=message):
        check_saved_state({name: torch.zeros(shape) for name, shape in saved.items()}, own)
