"""Where the centre of mass must go for the feet to carry it: a plan by quadratic programming.

A robot on flat ground does not tip while its zero-moment point (ZMP) stays within the support
polygon, the hull of what touches the floor (Vukobratovic). With the angular momentum known, the
ZMP is linear in the path of the centre of mass, so that the smoothest path that keeps the ZMP
inside is a quadratic program over the coefficients of a spline.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import daqp
import numpy as np
from scipy.interpolate import BSpline

GRAVITY = 9.81
ZMP_MARGIN_M = 0.01  # how far inside the polygon the ZMP stays
COM_MARGIN_M = 0.003  # likewise the centre of mass, where it moves slowly
# Below this speed the centre of mass must be above the feet, as if the robot stood still.
SLOW_SPEED_M_S = 0.1

# Feet that carry less than this share of the weight, at take-off and landing, count as flying.
_LEAST_LOAD = 0.3
_DEGREE = 5
_KNOT_SPACING_S = 0.1
_JERK_WEIGHT = 1e-4  # (m/s^3)^2 against m^2 of ZMP off its target
_FLIGHT_WEIGHT = 1.0  # (m/s^2)^2 likewise
_HEIGHT_JERK_WEIGHT = 1e-7  # (m/s^3)^2 against m^2 of height off what is written
_EDGE_WEIGHT = 30.0  # of the heights at take-off and landing against the others
# Where the constraints contradict one another the plan breaks them a little, and evenly.
_SOFTNESS = 1e-4
_TOLERANCE_M = 0.01  # how far outside a finished plan's ZMP may be
_SOFT, _EQUAL = 8, 5  # DAQP's names for kinds of constraints


@dataclass(frozen=True)
class Support:
    """What the feet allow, one row a frame.

    Attributes:
        planes: half-planes [n, 3] of the support polygon (see ``feet.half_planes``), or None
            while nothing touches the floor.
        target: [T, 2], where in it the ZMP should rather be, in metres.
        reach: half-planes [n, 3] within which the legs can carry the centre of mass.
    """

    planes: list[np.ndarray | None]
    target: np.ndarray
    reach: list[np.ndarray]


@dataclass(frozen=True)
class MassEstimate:
    """How the robot differs from a point mass at its pelvis, one row a frame; metres.

    Attributes:
        height: [T], of the centre of mass.
        zmp_offset: [T, 2], what angular momentum adds to the ZMP of the linear motion.
        pelvis_offset: [T, 3], from the centre of mass to the pelvis.
        slow: [T] bool, where the centre of mass must stay inside the support polygon.
    """

    height: np.ndarray
    zmp_offset: np.ndarray
    pelvis_offset: np.ndarray
    slow: np.ndarray


def plan_com(support: Support, mass: MassEstimate, times_s: np.ndarray) -> np.ndarray:
    """The path of the centre of mass over the floor, from rest to rest.

    Returns:
        [T, 2], metres. It starts and ends at rest at the support's first and last target.

    Raises:
        ValueError: there is no such path.
    """
    basis = _Basis(times_s)
    # ZMP = c - h / (g + h'') c'' + offset; in flight there is none, and c'' = 0 takes its place.
    load = _load(mass, times_s)
    zmp = basis.values - (mass.height / (GRAVITY * load))[:, None] * basis.accelerations
    flying = np.array([planes is None for planes in support.planes]) | (load <= _LEAST_LOAD)
    falls = basis.accelerations[flying]
    cost = _JERK_WEIGHT * basis.jerks.T @ basis.jerks + _FLIGHT_WEIGHT * falls.T @ falls
    cost += zmp[~flying].T @ zmp[~flying]
    pull = (support.target - mass.zmp_offset)[~flying].T @ zmp[~flying]  # [2, n]
    planes = [None if out else edges for out, edges in zip(flying, support.planes, strict=True)]
    slow = [edges if rests else None for edges, rests in zip(planes, mass.slow, strict=True)]
    still = np.zeros_like(mass.zmp_offset)
    limits = [
        _inside(planes, zmp, mass.zmp_offset, ZMP_MARGIN_M),
        _inside(slow, basis.values, still, COM_MARGIN_M),
        _inside(support.reach, basis.values, still, 0.0),
    ]
    ends = basis.at_rest(support.target[0], support.target[-1])
    solution = _solve(np.kron(np.eye(2), cost), -pull.reshape(-1), ends, limits)
    return basis.values @ solution.reshape(2, -1).T


def plan_height(height_m: np.ndarray, flying: np.ndarray, times_s: np.ndarray) -> np.ndarray:
    """A height [T] that falls freely where ``flying`` [T], and else is close to ``height_m`` [T].

    Closest at take-off and landing, because these settle the flight between them.
    """
    basis = _Basis(times_s)
    edges = np.zeros(len(times_s), dtype=bool)
    edges[:-1] |= flying[1:]
    edges[1:] |= flying[:-1]
    weight = np.where(edges, _EDGE_WEIGHT, 1.0)[~flying]
    rows = [
        basis.values[~flying] * weight[:, None],
        basis.accelerations[flying] * _FLIGHT_WEIGHT,
        basis.jerks * np.sqrt(_HEIGHT_JERK_WEIGHT),
    ]
    values = [
        height_m[~flying] * weight,
        np.full(flying.sum(), -GRAVITY * _FLIGHT_WEIGHT),
        np.zeros(len(times_s)),
    ]
    solution = np.linalg.lstsq(np.concatenate(rows), np.concatenate(values))[0]
    return basis.values @ solution


def check_balance(
    com: np.ndarray, support: Support, mass: MassEstimate, times_s: np.ndarray
) -> None:
    """Check that a path of the centre of mass keeps the ZMP over the feet.

    Raises:
        ValueError: it does not; the message gives the time at which it is furthest off.
    """
    load = _load(mass, times_s)
    lever = (mass.height / (GRAVITY * load))[:, None]
    zmp = com + mass.zmp_offset - lever * _second_derivative(com, times_s)
    outside = [
        -np.inf
        if planes is None or share <= _LEAST_LOAD
        else (planes[:, :2] @ point + planes[:, 2]).max()
        for planes, point, share in zip(support.planes, zmp, load, strict=True)
    ]
    if max(outside) > _TOLERANCE_M:
        raise ValueError(
            f"at {times_s[np.argmax(outside)]:.2f} s the weight is {1000 * max(outside):.0f} mm "
            "beside the feet that must carry it: begin the swing later, make it longer, or put "
            "the weight on the standing foot before (weight_on_right)"
        )


def _solve(
    hessian: np.ndarray,
    gradient: np.ndarray,
    equalities: tuple[np.ndarray, np.ndarray],
    limits: list[tuple[np.ndarray, np.ndarray]],
) -> np.ndarray:
    """The x that minimises x'Hx/2 + g'x, with A x = b for the first rows, and softly <= b."""
    parts = zip(equalities, *limits, strict=True)
    rows, bounds = (np.concatenate(part) for part in parts)
    equal = np.arange(len(bounds)) < len(equalities[1])
    solution, _, flag, _ = daqp.solve(
        hessian,
        gradient,
        rows,
        bounds,
        np.where(equal, bounds, -1e30),
        np.where(equal, _EQUAL, _SOFT).astype(np.int32),
        rho_soft=_SOFTNESS,
    )
    if flag < 1:
        raise ValueError(f"no path of the centre of mass was found (DAQP exit flag {flag})")
    return solution


def _load(mass: MassEstimate, times_s: np.ndarray) -> np.ndarray:
    """What the feet carry, [T], as a share of the robot's weight; at least ``_LEAST_LOAD``."""
    return np.maximum(1 + _second_derivative(mass.height, times_s) / GRAVITY, _LEAST_LOAD)


def _second_derivative(values: np.ndarray, times_s: np.ndarray) -> np.ndarray:
    return np.gradient(np.gradient(values, times_s, axis=0), times_s, axis=0)


def _inside(
    planes: Sequence[np.ndarray | None],
    point_rows: np.ndarray,
    offset_m: np.ndarray,
    margin_m: float,
) -> tuple[np.ndarray, np.ndarray]:
    """Rows A and bounds b with A x <= b where a point is ``margin_m`` inside its half-planes.

    The point is ``point_rows[t] @ x + offset_m[t]`` for the coefficients x of each axis.
    """
    rows, bounds = [np.empty((0, 2 * point_rows.shape[1]))], [np.empty(0)]
    for t, edges in enumerate(planes):
        if edges is not None and len(edges):
            rows.append(np.kron(edges[:, :2], point_rows[t][None]))
            bounds.append(-edges[:, 2] - edges[:, :2] @ offset_m[t] - margin_m)
    return np.concatenate(rows), np.concatenate(bounds)


class _Basis:
    """A clamped quintic B-spline and its derivatives at the frames' times, as matrices [T, n]."""

    def __init__(self, times_s: np.ndarray) -> None:
        spans = max(int(np.ceil((times_s[-1] - times_s[0]) / _KNOT_SPACING_S)), 2)
        inner = np.linspace(times_s[0], times_s[-1], spans + 1)
        knots = np.concatenate([[inner[0]] * _DEGREE, inner, [inner[-1]] * _DEGREE])
        self.size = spans + _DEGREE
        spline = BSpline(knots, np.eye(self.size), _DEGREE)
        self.values = spline(times_s)
        self.accelerations = spline.derivative(2)(times_s)
        self.jerks = spline.derivative(3)(times_s)

    def at_rest(self, start: np.ndarray, end: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Rows and values that pin the ends: of a clamped spline, three equal coefficients."""
        ends = np.vstack([np.eye(self.size)[:3], np.eye(self.size)[-3:]])
        values = [np.repeat([start[axis], end[axis]], 3) for axis in range(2)]
        return np.kron(np.eye(2), ends), np.concatenate(values)
