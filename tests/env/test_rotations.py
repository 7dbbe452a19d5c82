"""Quaternion algebra against SciPy's Rotation and MuJoCo."""

import math

import mujoco
import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.spatial.transform import Rotation

from tlr_exp.env import rotations

components = st.floats(-1.0, 1.0, width=32)
vectors = arrays(np.float64, (3,), elements=components)
# Rounded, so that no component is so small that its square is lost.
quats = (
    arrays(np.float64, (4,), elements=components)
    .map(lambda q: np.round(q, 6))
    .filter(lambda q: np.linalg.norm(q) > 0.1)
    .map(lambda q: q / np.linalg.norm(q))
)


def scipy(quat_wxyz: np.ndarray) -> Rotation:
    return Rotation.from_quat(quat_wxyz, scalar_first=True)


def tensor(array: np.ndarray) -> torch.Tensor:
    return torch.from_numpy(np.asarray(array, dtype=np.float64))


def assert_near(found: torch.Tensor, expected: np.ndarray, atol: float = 1e-12) -> None:
    np.testing.assert_allclose(found.numpy(), expected, atol=atol, rtol=0)


@given(quats, vectors)
def test_rotate_and_its_inverse_are_scipy_s(quat, vector):
    assert_near(rotations.rotate(tensor(quat), tensor(vector)), scipy(quat).apply(vector))
    assert_near(
        rotations.rotate_inverse(tensor(quat), tensor(vector)),
        scipy(quat).apply(vector, inverse=True),
    )


@given(quats)
def test_rotation_matrix_is_scipy_s(quat):
    assert_near(rotations.rotation_matrix(tensor(quat)), scipy(quat).as_matrix())


@given(quats, quats)
def test_product_turns_first_by_the_right_factor(left, right):
    product = rotations.multiply(tensor(left), tensor(right)).numpy()
    np.testing.assert_allclose(
        scipy(product).as_matrix(), scipy(left).as_matrix() @ scipy(right).as_matrix(), atol=1e-12
    )


@given(quats)
def test_conjugate_undoes_the_rotation(quat):
    product = rotations.multiply(rotations.conjugate(tensor(quat)), tensor(quat))
    assert_near(product, np.array([1.0, 0.0, 0.0, 0.0]))


@given(quats, quats)
def test_angle_between_orientations_is_scipy_s(first, second):
    expected = (scipy(first) * scipy(second).inv()).magnitude()
    assert_near(rotations.rotation_angle(tensor(first), tensor(second)), expected, atol=1e-7)


@given(quats, quats)
def test_angle_is_the_same_for_the_two_quaternions_of_an_orientation(first, second):
    angle = rotations.rotation_angle(tensor(first), tensor(second))
    assert 0.0 <= angle <= math.pi + 1e-12
    assert_near(rotations.rotation_angle(tensor(-first), tensor(second)), angle.numpy())
    assert_near(rotations.rotation_angle(tensor(second), tensor(first)), angle.numpy())


@given(
    arrays(np.float64, (3,), elements=components)
    .filter(lambda v: np.linalg.norm(v) > 0.1)
    .map(lambda v: v / np.linalg.norm(v)),
    st.floats(0.0, 3.1),
)
def test_rotation_vector_is_scipy_s_and_unit(axis, angle):
    quat = rotations.from_rotation_vector(tensor(axis * angle))
    assert quat.norm() == pytest.approx(1.0, abs=1e-14)
    np.testing.assert_allclose(
        scipy(quat.numpy()).as_matrix(), Rotation.from_rotvec(axis * angle).as_matrix(), atol=1e-12
    )


def test_no_rotation_is_the_identity():
    assert rotations.from_rotation_vector(torch.zeros(2, 3)).tolist() == [[1.0, 0.0, 0.0, 0.0]] * 2


@pytest.mark.parametrize("angle", [1e-6, 1e-5, 1e-4, 1e-3, 0.1])
def test_small_angles_survive_single_precision(angle):
    """An arc cosine in float32 knows nothing below 3e-4 rad."""
    turn = Rotation.from_rotvec([0.0, angle, 0.0])
    # About the identity components near 0 are held exactly; elsewhere to 6e-8 each.
    identity = torch.tensor([1.0, 0.0, 0.0, 0.0])
    turned = torch.tensor(turn.as_quat(scalar_first=True), dtype=torch.float32)
    assert rotations.rotation_angle(turned, identity).item() == pytest.approx(angle, rel=1e-5)
    base = Rotation.from_rotvec([0.3, -1.1, 0.7])
    first, second = (
        torch.tensor(r.as_quat(scalar_first=True), dtype=torch.float32) for r in (turn * base, base)
    )
    assert rotations.rotation_angle(first, second).item() == pytest.approx(angle, abs=3e-7)


def test_angle_of_an_orientation_with_itself_is_exactly_zero():
    generator = torch.Generator().manual_seed(0)
    quat = torch.nn.functional.normalize(torch.randn(100, 4, generator=generator), dim=-1)
    assert not rotations.rotation_angle(quat, quat).any()
    assert not rotations.rotation_angle(quat, -quat).any()


def test_half_a_turn_is_pi():
    identity, half_turn = torch.tensor([1.0, 0.0, 0.0, 0.0]), torch.tensor([0.0, 0.0, 1.0, 0.0])
    assert rotations.rotation_angle(half_turn, identity).item() == pytest.approx(math.pi, rel=1e-6)


@given(quats)
def test_projected_gravity_is_the_world_s_down_in_the_body_by_mujoco(quat):
    matrix = np.empty(9)
    mujoco.mju_quat2Mat(matrix, quat)
    assert_near(
        rotations.projected_gravity(tensor(quat)),
        matrix.reshape(3, 3).T @ np.array([0.0, 0.0, -1.0]),
    )


def test_projected_gravity_by_hand():
    # Pitched forward by 90 deg about y the nose (x) points down; rolled by 90 deg about x the
    # left side (y) points up.
    root = math.sqrt(0.5)
    poses = torch.tensor([[1.0, 0, 0, 0], [root, 0, root, 0], [root, root, 0, 0]])
    expected = torch.tensor([[0.0, 0, -1], [1, 0, 0], [0, -1, 0]])
    torch.testing.assert_close(rotations.projected_gravity(poses), expected, atol=1e-6, rtol=0)


@settings(max_examples=20)
@given(quats, vectors)
def test_functions_agree_with_mujoco_s(quat, vector):
    rotated, product = np.empty(3), np.empty(4)
    mujoco.mju_rotVecQuat(rotated, vector, quat)
    other = np.array([0.5, -0.5, 0.5, 0.5])
    mujoco.mju_mulQuat(product, quat, other)
    assert_near(rotations.rotate(tensor(quat), tensor(vector)), rotated)
    assert_near(rotations.multiply(tensor(quat), tensor(other)), product)


def test_leading_shapes_are_kept():
    quat = torch.tensor([1.0, 0, 0, 0]).expand(2, 5, 4)
    vector = torch.arange(30.0).reshape(2, 5, 3)
    assert torch.equal(rotations.rotate(quat, vector), vector)
    assert rotations.rotation_matrix(quat).shape == (2, 5, 3, 3)
    assert rotations.rotation_angle(quat, quat).shape == (2, 5)
    assert rotations.projected_gravity(quat).shape == (2, 5, 3)
    assert rotations.from_rotation_vector(vector).shape == (2, 5, 4)
