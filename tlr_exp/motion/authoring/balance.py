"""Plans where the centre of mass must go for the feet to carry it, by quadratic programming.

A robot on flat ground does not tip while its zero-moment point (ZMP) stays within the support
polygon, the hull of what touches the floor (Vukobratovic). With the angular momentum known, the
ZMP is linear in the path of the centre of mass, so that the smoothest path that keeps the ZMP
inside is a quadratic program over the coefficients of a spline.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import daqp
import numpy as np
from scipy.interpolate import BSpline

from tlr_exp.errors import UserError

GRAVITY = 9.81
ZMP_MARGIN_M = 0.01  # how far inside the polygon the ZMP stays
COM_MARGIN_M = 0.003  # likewise the centre of mass, where it moves slowly
# Below this speed the centre of mass must be above the feet, as if the robot stood still.
SLOW_SPEED_M_S = 0.1

# Where feet carry less than this share of the weight, at take-off and landing, the ZMP is not
# checked, and its limits in the plan fade to those of flight: no force along the floor.
_LEAST_LOAD = 0.3
_DEGREE = 5
_FLIGHT_EDGE = 3  # equal knots at take-off and landing, where the jerk jumps
_KNOT_SPACING_S = 0.1
_JERK_WEIGHT = 1e-4  # (m/s^3)^2 against m^2 of ZMP off its target
# Likewise this near to a flight: running steps brake and drive within a fraction of a second.
_FLIGHT_JERK_WEIGHT, _HURRY_S = 1e-6, 0.3
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
        flights: take-off and landing frames, the last before and the first after each flight.
    """

    planes: list[np.ndarray | None]
    target: np.ndarray
    reach: list[np.ndarray]
    flights: Sequence[tuple[int, int]] = ()


@dataclass(frozen=True)
class MassEstimate:
    """How the robot differs from a point mass at its pelvis, one row a frame; metres.

    Attributes:
        height: [T], of the centre of mass.
        load: [T], what the feet carry, as a share of the robot's weight.
        zmp_offset: [T, 2], what angular momentum adds to the ZMP of the linear motion.
        pelvis_offset: [T, 3], from the centre of mass to the pelvis.
        slow: [T] bool, where the centre of mass must stay inside the support polygon.
    """

    height: np.ndarray
    load: np.ndarray
    zmp_offset: np.ndarray
    pelvis_offset: np.ndarray
    slow: np.ndarray


def plan_com(support: Support, mass: MassEstimate, times_s: np.ndarray) -> np.ndarray:
    """The path of the centre of mass over the floor, from rest to rest.

    Returns:
        [T, 2], metres. It starts and ends at rest at the support's first and last target, and is
        straight and of constant speed in flight.

    Raises:
        ValueError: there is no such path.
    """
    basis = _Basis(times_s, support.flights)
    faded = np.clip(mass.load / _LEAST_LOAD, 0.0, 1.0)
    zmp = faded[:, None] * basis.values - _lever(mass) * basis.accelerations
    offset = faded[:, None] * mass.zmp_offset
    standing = np.array([planes is not None for planes in support.planes])
    cost = _jerk_cost(basis, support.flights, times_s)
    cost += zmp[standing].T @ zmp[standing]
    pull = (faded[:, None] * support.target - offset)[standing].T @ zmp[standing]  # [2, n]
    planes = [
        None if edges is None else edges * [1.0, 1.0, share]
        for edges, share in zip(support.planes, faded, strict=True)
    ]
    slow = [
        edges if rests else None for edges, rests in zip(support.planes, mass.slow, strict=True)
    ]
    still, no_margin = np.zeros_like(offset), np.zeros_like(faded)
    limits = [
        _inside(planes, zmp, offset, ZMP_MARGIN_M * faded),
        _inside(slow, basis.values, still, COM_MARGIN_M + no_margin),
        _inside(support.reach, basis.values, still, no_margin),
    ]
    falls, ends = np.kron(np.eye(2), basis.falls), basis.at_rest(support.target[[0, -1]])
    equalities = np.concatenate([ends[0], falls]), np.append(ends[1], np.zeros(len(falls)))
    solution = _solve(np.kron(np.eye(2), cost), -pull.reshape(-1), equalities, limits)
    return basis.values @ solution.reshape(2, -1).T


def _lever(mass: MassEstimate) -> np.ndarray:
    """h / (g + h''), [T, 1] in s^2: the ZMP is this times the acceleration behind the mass."""
    return (mass.height / (GRAVITY * np.maximum(mass.load, _LEAST_LOAD)))[:, None]


def _jerk_cost(
    basis: "_Basis", flights: Sequence[tuple[int, int]], times_s: np.ndarray
) -> np.ndarray:
    """What jerk costs, [n, n] for coefficients of the spline; little near flights."""
    weight = np.full(len(times_s), _JERK_WEIGHT)
    for up, down in flights:
        near = (times_s > times_s[up] - _HURRY_S) & (times_s < times_s[down] + _HURRY_S)
        weight[near] = _FLIGHT_JERK_WEIGHT
    return basis.jerks.T @ (weight[:, None] * basis.jerks)


def plan_height(
    height_m: np.ndarray, flights: Sequence[tuple[int, int]], times_s: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """A height that falls freely in flight, and else is close to ``height_m`` [T].

    Closest at take-off and landing, because these settle the flight between them. It starts and
    ends at rest, and never falls faster than freely.

    Returns:
        Height [T] in m and its second derivative [T] in m/s^2.

    Raises:
        ValueError: there is no such height.
    """
    basis = _Basis(times_s, flights)
    weight = np.ones(len(times_s))
    for up, down in flights:
        weight[up + 1 : down] = 0.0
        weight[[up, down]] = _EDGE_WEIGHT
    rows = basis.values * weight[:, None]
    cost = rows.T @ rows + _HEIGHT_JERK_WEIGHT * basis.jerks.T @ basis.jerks
    ends = basis.at_rest(height_m[[0, -1], None])
    falls = np.full(len(basis.falls), -GRAVITY)
    equalities = np.concatenate([ends[0], basis.falls]), np.append(ends[1], falls)
    limit = -basis.accelerations, np.full(len(times_s), GRAVITY)
    solution = _solve(cost, -rows.T @ (weight * height_m), equalities, [limit])
    return basis.values @ solution, basis.accelerations @ solution


def check_balance(
    com: np.ndarray, support: Support, mass: MassEstimate, times_s: np.ndarray
) -> None:
    """Check that a path of the centre of mass keeps the ZMP over the feet.

    Raises:
        ValueError: it does not; the message gives the time at which it is furthest off.
    """
    zmp = com + mass.zmp_offset - _lever(mass) * _second_derivative(com, times_s)
    outside = [
        -np.inf
        if planes is None or share <= _LEAST_LOAD
        else (planes[:, :2] @ point + planes[:, 2]).max()
        for planes, point, share in zip(support.planes, zmp, mass.load, strict=True)
    ]
    if max(outside) > _TOLERANCE_M:
        raise UserError(
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
        raise UserError(f"no path of the centre of mass was found (DAQP exit flag {flag})")
    return solution


def load_of(height: np.ndarray, times_s: np.ndarray) -> np.ndarray:
    """What the feet carry, [T], as a share of the weight, for the mass's height [T] in m."""
    return 1 + _second_derivative(height, times_s) / GRAVITY


def _second_derivative(values: np.ndarray, times_s: np.ndarray) -> np.ndarray:
    return np.gradient(np.gradient(values, times_s, axis=0), times_s, axis=0)


def _inside(
    planes: Sequence[np.ndarray | None],
    point_rows: np.ndarray,
    offset_m: np.ndarray,
    margin_m: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """Rows A and bounds b with A x <= b where a point is ``margin_m`` [T] inside its half-planes.

    The point is ``point_rows[t] @ x + offset_m[t]`` for the coefficients x of each axis.
    """
    rows, bounds = [np.empty((0, 2 * point_rows.shape[1]))], [np.empty(0)]
    for t, edges in enumerate(planes):
        if edges is not None and len(edges):
            rows.append(np.kron(edges[:, :2], point_rows[t][None]))
            bounds.append(-edges[:, 2] - edges[:, :2] @ offset_m[t] - margin_m[t])
    return np.concatenate(rows), np.concatenate(bounds)


class _Basis:
    """A clamped quintic B-spline and its derivatives at the frames' times, as matrices [T, n].

    A flight is one piece, so that a few equations make it a parabola: ``falls`` [4 a flight, n]
    gives accelerations that determine it. At its ends the acceleration is still continuous.
    """

    def __init__(self, times_s: np.ndarray, flights: Sequence[tuple[int, int]] = ()) -> None:
        edges = times_s[[0, *(frame for flight in flights for frame in flight), -1]]
        knots = [edges[:1]] * _DEGREE
        for number, (start, end) in enumerate(pairwise(edges)):
            flying = number % 2
            spans = 1 if flying else max(int(np.ceil((end - start) / _KNOT_SPACING_S)), 2)
            inner = np.linspace(start, end, spans + 1)
            knots += [inner] if number == 0 else [inner[:1]] * (_FLIGHT_EDGE - 2) + [inner]
        knots = np.concatenate([*knots, *[edges[-1:]] * _DEGREE])
        self.size = len(knots) - _DEGREE - 1
        spline = BSpline(knots, np.eye(self.size), _DEGREE)
        self.values = spline(times_s)
        self.accelerations = spline.derivative(2)(times_s)
        self.jerks = spline.derivative(3)(times_s)
        flying_s = [np.linspace(times_s[up], times_s[down], _DEGREE - 1) for up, down in flights]
        self.falls = spline.derivative(2)(np.concatenate([np.empty(0), *flying_s]))

    def at_rest(self, ends: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Rows and values that pin both ends [2, axes]: of a clamped spline, three coefficients."""
        rows = np.vstack([np.eye(self.size)[:3], np.eye(self.size)[-3:]])
        axes = ends.shape[1]
        return np.kron(np.eye(axes), rows), np.repeat(ends.T, 3)
