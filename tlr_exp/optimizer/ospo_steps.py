"""The single steps of OSPO, as pure functions in the unit cube; `ospo.py` puts them together."""

import math

import torch
from torch import Tensor

EXTRAPOLATION_SHARES = (1.0, 0.5, 0.1, 0.005)
EXTRAPOLATION_SAMPLES = 19
STAGE_STD = 0.1  # (ub - lb) / 10: the largest standard deviation at a start


def diagonal_points(count: int, dims: int, generator: torch.Generator) -> Tensor:
    """Step 1: one uniform point in each of `count` equal parts of the diagonal [count, dims]."""
    device = generator.device
    within = torch.rand(count, generator=generator, device=device, dtype=torch.float64)
    share = (torch.arange(count, device=device) + within) / count
    return share[:, None].repeat(1, dims)


def neighbours(
    centres: Tensor, std: float | Tensor, count: int, generator: torch.Generator
) -> Tensor:
    """Gaussian points around each centre [n, dims], clipped to the cube [n, count, dims]."""
    shape = (len(centres), count, centres.shape[1])
    noise = torch.randn(shape, generator=generator, device=centres.device, dtype=centres.dtype)
    return (centres[:, None] + std * noise).clamp(0.0, 1.0)


def normal_samples(
    mean: Tensor, covariance: Tensor, count: int, generator: torch.Generator
) -> Tensor:
    """Step 2: draws from N(mean, covariance), clipped to the cube [count, dims].

    By eigenvalues, because the covariance of a few elites is singular in many dimensions.
    """
    eigenvalues, vectors = torch.linalg.eigh(covariance)
    noise = torch.randn(
        (count, len(mean)), generator=generator, device=mean.device, dtype=mean.dtype
    )
    return (mean + (noise * eigenvalues.clamp(min=0.0).sqrt()) @ vectors.T).clamp(0.0, 1.0)


def jump_directions(best_three: Tensor, values: Tensor, reach: Tensor) -> Tensor:
    """Step 3: sum over i = 1, 2 of d_i (E / |d_i|) w_i / (w_1 + w_2), for each E [trials, dims].

    d_i = x_1 - x_(i+1) and w_i = f_(i+1) - f_1. A d_i of length 0 adds nothing; if both w_i are 0
    they count the same. (The source leaves both cases open.)

    Args:
        best_three: x_1, x_2, x_3 [3, dims].
        values: f_1 <= f_2 <= f_3 [3].
        reach: E of each trial [trials].
    """
    difference = best_three[0] - best_three[1:]
    length = difference.norm(dim=1, keepdim=True)
    unit = torch.where(length > 0, difference / length.clamp(min=1e-300), 0.0)
    weight = values[1:] - values[0]
    total = weight.sum()
    share = weight / total if 0 < total < math.inf else torch.full_like(weight, 0.5)
    return reach[:, None] * (share[:, None] * unit).sum(dim=0)


def weighted_mean(positions: Tensor, values: Tensor) -> Tensor:
    """Step 4: mean of positions [n, dims] weighted by (f_max - f) / (f_max - f_min) [dims].

    The plain mean where all values [n] are the same. (The source leaves this case open.)
    """
    weight = values.max() - values
    total = weight.sum()
    if not 0 < total < math.inf:
        return positions.mean(dim=0)
    return (weight[:, None] * positions).sum(dim=0) / total


def covariance_of(positions: Tensor) -> Tensor:
    """Sample covariance of positions [n, dims], n >= 2 [dims, dims]."""
    centred = positions - positions.mean(dim=0)
    return centred.T @ centred / (len(positions) - 1)


def extrapolations(elite: Tensor, worse: Tensor, age: int, generator: torch.Generator) -> Tensor:
    """Step 5: points beyond the elite in the direction from a worse elite [23, dims].

    With D = elite - worse: 19 Gaussian points around elite + s D with standard deviation
    |D| s / 3 in each coordinate, where s is 1, 0.5, 0.1, 0.005 at age 1, 2, 3 and more; and the
    four points elite + D {1, 0.5, 0.1, 0.005}. (The source does not say what the Gaussian points
    stand around, nor what the age counts: here the inner iterations since the worse elite.)
    """
    step = elite - worse
    share = EXTRAPOLATION_SHARES[min(age, len(EXTRAPOLATION_SHARES)) - 1]
    around = neighbours(
        (elite + share * step)[None], step.abs() * share / 3.0, EXTRAPOLATION_SAMPLES, generator
    )[0]
    shares = torch.tensor(EXTRAPOLATION_SHARES, device=elite.device, dtype=elite.dtype)
    return torch.cat([around, elite + shares[:, None] * step]).clamp(0.0, 1.0)


def improvement_percent(before: float, after: float) -> float:
    """P of step 7: by how many percent of its size a value fell, from 0 to 100."""
    if before == 0.0 or not math.isfinite(before):
        return 0.0 if before == after else 100.0
    return min(max(100.0 * (before - after) / abs(before), 0.0), 100.0)


def growth_share(percent: float) -> float:
    """p of step 7 for an improvement of P percent; it jumps at 1, 5 and 10 %, as in the source."""
    if percent > 10.0:
        return 0.5 + 0.5 * (percent - 10.0) / 90.0
    if percent > 5.0:
        return 0.2 + 0.3 * (percent - 5.0) / 5.0
    if percent > 1.0:
        return 0.1 + 0.1 * (percent - 1.0) / 4.0
    return 0.1 * percent


def energy(covariance: Tensor) -> float:
    """E of step 7: the length of the diagonal."""
    return covariance.diagonal().norm().item()


def energy_limit(dims: int) -> float:
    """T of step 7: |(ub - lb) / 10|. (A length, beside which E, of variances, is put as it is.)"""
    return STAGE_STD * math.sqrt(dims)


def grown_factor(present: float, of_samples: float, percent: float, limit: float) -> float:
    """Step 7 where E < B: min((B - E) p + E, T) / E."""
    grown = (of_samples - present) * growth_share(percent) + present
    return min(grown, limit) / present


def kicked_factor(present: float, kick: float) -> float:
    """Step 7 where E >= B: min(2, max(K / E, 1.1))."""
    return min(2.0, max(kick / present, 1.1))


def isotropic(covariance: Tensor) -> Tensor:
    """Step 8: the same mean variance in every direction."""
    dims = len(covariance)
    eye = torch.eye(dims, device=covariance.device, dtype=covariance.dtype)
    return covariance.diagonal().mean() * eye


def with_floor(covariance: Tensor, std: float) -> Tensor:
    """Step 8: the variance of every coordinate raised to at least std^2."""
    missing = (std**2 - covariance.diagonal()).clamp(min=0.0)
    return covariance + missing.diag()
