"""Batched quaternion algebra; quaternions are wxyz and of unit length, vectors have three axes."""

from functools import reduce

import torch
from torch import Tensor


def rotate(quat_wxyz: Tensor, vector: Tensor) -> Tensor:
    """Rotate ``vector`` [..., 3] by ``quat_wxyz`` [..., 4]."""
    real, imaginary = quat_wxyz[..., :1], quat_wxyz[..., 1:]
    twice_cross = 2.0 * torch.linalg.cross(imaginary, vector)
    return vector + real * twice_cross + torch.linalg.cross(imaginary, twice_cross)


def rotate_inverse(quat_wxyz: Tensor, vector: Tensor) -> Tensor:
    """Express the world-frame ``vector`` [..., 3] in the frame of ``quat_wxyz`` [..., 4]."""
    return rotate(conjugate(quat_wxyz), vector)


def conjugate(quat_wxyz: Tensor) -> Tensor:
    """The inverse rotation of a unit quaternion, [..., 4]."""
    return torch.cat((quat_wxyz[..., :1], -quat_wxyz[..., 1:]), dim=-1)


def multiply(left: Tensor, right: Tensor) -> Tensor:
    """Hamilton product [..., 4]: first rotate by ``right``, then by ``left``."""
    left_real, left_imag = left[..., :1], left[..., 1:]
    right_real, right_imag = right[..., :1], right[..., 1:]
    real = left_real * right_real - (left_imag * right_imag).sum(-1, keepdim=True)
    imag = left_real * right_imag + right_real * left_imag
    return torch.cat((real, imag + torch.linalg.cross(left_imag, right_imag)), dim=-1)


def rotation_angle(first: Tensor, second: Tensor) -> Tensor:
    """Angle in rad, within [0, pi], of the rotation between two orientations [..., 4] -> [...].

    From the chord |first - second| = 2 sin(angle / 4), which keeps its precision at small angles
    where the arc cosine of the scalar part loses half of the digits.
    """
    chord = torch.minimum(squared_length(first - second), squared_length(first + second)).sqrt()
    return 4.0 * torch.asin((0.5 * chord).clamp(max=1.0))


def squared_length(vectors: Tensor) -> Tensor:
    """Squared length of vectors of a few components, [..., k] -> [...].

    Component by component, because a sum over so few numbers takes several times as long.
    """
    return reduce(torch.add, vectors.square().unbind(-1))


def projected_gravity(quat_wxyz: Tensor) -> Tensor:
    """Direction of gravity in the frame of ``quat_wxyz`` [..., 4] -> [..., 3]; upright: (0, 0, -1).

    The third row of the rotation matrix, negated.
    """
    w, x, y, z = quat_wxyz.unbind(-1)
    return torch.stack(
        (2.0 * (w * y - x * z), -2.0 * (w * x + y * z), 2.0 * (x * x + y * y) - 1.0), dim=-1
    )


def rotation_matrix(quat_wxyz: Tensor) -> Tensor:
    """Rotation matrix [..., 3, 3] of a unit quaternion [..., 4]; its columns are the axes."""
    # Twice the products of all pairs, in one operation.
    products = (2.0 * quat_wxyz).unsqueeze(-1) * quat_wxyz.unsqueeze(-2)
    _, wx, wy, wz, _, xx, xy, xz, _, _, yy, yz, _, _, _, zz = products.flatten(-2).unbind(-1)
    rows = (
        *(1.0 - (yy + zz), xy - wz, xz + wy),
        *(xy + wz, 1.0 - (xx + zz), yz - wx),
        *(xz - wy, yz + wx, 1.0 - (xx + yy)),
    )
    return torch.stack(rows, dim=-1).unflatten(-1, (3, 3))


def into_frame(vectors: Tensor, matrix: Tensor) -> Tensor:
    """Express world-frame ``vectors`` [n, k, 3] in the frame of rotation ``matrix`` [n, 3, 3].

    Row vectors times the matrix. By NumPy where it can be, because PyTorch takes five times as long
    for a batch of matrices this small.
    """
    if vectors.device.type == "cpu":
        return torch.from_numpy(vectors.numpy() @ matrix.numpy())
    return vectors @ matrix


def from_rotation_vector(rotation_vector: Tensor) -> Tensor:
    """Unit quaternion [..., 4] of a rotation vector [..., 3] in rad."""
    half = 0.5 * rotation_vector.norm(dim=-1, keepdim=True)
    # sinc keeps the limit at a zero rotation.
    scale = 0.5 * torch.sinc(half / torch.pi)
    return torch.cat((torch.cos(half), scale * rotation_vector), dim=-1)
