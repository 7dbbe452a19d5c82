"""Reward terms: each a pure function of one transition that returns its raw, unweighted value.

A term is stated here and nowhere else: its name is the function's, its constants are what the
function takes by keyword, and the decorator says its kind, formula and unit. Every term maps a
``Transition`` of ``num_envs`` environments to a float32 tensor [num_envs]. A coefficient or a
weight has no place here: see ``tlr_exp.reward.split``.

PyTorch is not imported, so that a configuration is checked and a report written without it: terms
use the methods of the tensors that they are given.

In formulas N is the number of bodies, or that of joints (23) where a sum is over i; "base" is the
frame of the pelvis; σ (``sigma``) and ε (``margin``) are constants.
"""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from torch import Tensor

    from tlr_exp.env.transition import Transition


@dataclass(frozen=True)
class Term:
    """A reward term; called with a transition and its constants it gives its raw value.

    Attributes:
        function: computes it.
        is_cost: at least 0, and enters the reward with a negative coefficient; else it tells how
            well the robot tracks, within [0, 1], and is 1 at perfect tracking.
        formula: of the raw value, as a report shows it.
        unit: of the raw value.
        of_paper: whether the paper's lower layer has it (Table 1, Figure 14).
        of_state: whether it is a cost that depends on the state alone, not on how the robot came
            there, so that it can be a potential.
    """

    function: Callable[..., Tensor]
    is_cost: bool
    formula: str
    unit: str
    of_paper: bool = False
    of_state: bool = False

    def __call__(self, step: Transition, **constants: float) -> Tensor:
        return self.function(step, **constants)

    @property
    def name(self) -> str:
        """As in configurations and metrics."""
        return self.function.__name__

    @property
    def constants(self) -> tuple[str, ...]:
        """Names of what it takes besides the transition."""
        parameters = inspect.signature(self.function).parameters.values()
        return tuple(each.name for each in parameters if each.kind is each.KEYWORD_ONLY)


TERMS: dict[str, Term] = {}
"""All terms by name, in the order in which they stand here."""


def tracking(formula: str) -> Callable[[Callable[..., Tensor]], Term]:
    """Make a function the tracking term of that formula."""
    return partial(_listed, is_cost=False, formula=formula, unit="1")


def cost(
    formula: str, unit: str, of_paper: bool = False, of_state: bool = False
) -> Callable[[Callable[..., Tensor]], Term]:
    """Make a function the cost of that formula and unit."""
    facts = {"formula": formula, "unit": unit, "of_paper": of_paper, "of_state": of_state}
    return partial(_listed, is_cost=True, **facts)


def _listed(function: Callable[..., Tensor], **facts: Any) -> Term:
    term = Term(function, **facts)
    TERMS[term.name] = term
    return term


# --- upper layer: tracking -------------------------------------------------------------------


def _position_error(step: Transition, bodies: tuple[int, ...] | slice) -> Tensor:
    """Squared position error averaged over axes and bodies, m^2, [num_envs]."""
    return step.instant.squared_distance[:, bodies].mean(dim=-1) / 3.0


def _mean_square(vectors: Tensor) -> Tensor:
    """Mean over bodies of the squared length of ``vectors`` [num_envs, n, 3], [num_envs]."""
    # In one sum: sums over three numbers each take several times as long.
    return vectors.flatten(1).square().sum(dim=-1) / vectors.shape[1]


@tracking("exp(-(1/3N) Σ ‖p_ref - p‖² / σ)")
def body_pos(step: Transition, *, sigma: float) -> Tensor:
    """Over all bodies (section 3.2 of the paper); sigma in m^2."""
    return (-_position_error(step, slice(None)) / sigma).exp()


@tracking("exp(-(1/N) Σ θ² / σ)")
def body_rot(step: Transition, *, sigma: float) -> Tensor:
    """θ: angle between each body and its reference (section 3.2 of the paper); sigma in rad^2."""
    return (-step.instant.rotation_angle.square().mean(dim=-1) / sigma).exp()


@tracking("exp(-(1/N) Σ ‖v_ref - v‖² / σ)")
def body_vel(step: Transition, *, sigma: float) -> Tensor:
    """Over all bodies (section 3.2 of the paper); sigma in (m/s)^2."""
    error = step.reference.body_lin_vel_w - step.state.body_lin_vel_w
    return (-_mean_square(error) / sigma).exp()


@tracking("exp(-(1/N) Σ ‖ω_ref - ω‖² / σ)")
def body_ang_vel(step: Transition, *, sigma: float) -> Tensor:
    """Over all bodies (section 3.2 of the paper); sigma in (rad/s)^2."""
    error = step.reference.body_ang_vel_w - step.state.body_ang_vel_w
    return (-_mean_square(error) / sigma).exp()


@tracking("exp(-(1/3N) Σ ‖p_ref - p‖² / σ)")
def upper_body_pos(step: Transition, *, sigma: float) -> Tensor:
    """As ``body_pos`` over arms, hands and head (ASAP)."""
    return (-_position_error(step, step.spec.upper_body) / sigma).exp()


@tracking("exp(-(1/3N) Σ ‖p_ref - p‖² / σ)")
def lower_body_pos(step: Transition, *, sigma: float) -> Tensor:
    """As ``body_pos`` over pelvis, legs and torso (ASAP)."""
    return (-_position_error(step, step.spec.lower_body) / sigma).exp()


@tracking("exp(-(1/3N) Σ ‖p_ref - p‖² / σ)")
def three_point_pos(step: Transition, *, sigma: float) -> Tensor:
    """As ``body_pos`` over the hands and the head (ASAP)."""
    return (-_position_error(step, step.spec.three_points) / sigma).exp()


@tracking("exp(-(1/3N) Σ ‖p_ref - p‖² / σ)")
def feet_pos(step: Transition, *, sigma: float) -> Tensor:
    """As ``body_pos`` over the two ankle-roll links (ASAP)."""
    return (-_position_error(step, step.spec.feet) / sigma).exp()


@tracking("exp(-(1/N) Σ_i (q_ref,i - q_i)² / σ)")
def joint_pos(step: Transition, *, sigma: float) -> Tensor:
    """Over the joints (ASAP); sigma in rad^2."""
    error = step.reference.qpos[:, 7:] - step.state.qpos[:, 7:]
    return (-error.square().mean(dim=-1) / sigma).exp()


@tracking("exp(-(1/N) Σ_i (q̇_ref,i - q̇_i)² / σ)")
def joint_vel(step: Transition, *, sigma: float) -> Tensor:
    """Over the joints (ASAP); sigma in (rad/s)^2."""
    error = step.reference.qvel[:, 6:] - step.state.qvel[:, 6:]
    return (-error.square().mean(dim=-1) / sigma).exp()


# --- lower layer: penalties and regularisers -------------------------------------------------


def _outside_range(step: Transition, margin: float) -> Tensor:
    """How far each joint is inside the margin at either end of its range, rad, [num_envs, 23]."""
    low, high = step.limits.range_rad.unbind(-1)
    inset = margin * 0.5 * (high - low)
    position = step.state.qpos[:, 7:]
    over = (position - (high - inset)).clamp(min=0.0)
    under = ((low + inset) - position).clamp(min=0.0)
    return over + under


def _excess(values: Tensor, limit: Tensor, margin: float) -> Tensor:
    """How far ``values`` [num_envs, 23] of either sign are above the limit less its margin."""
    return (values.abs() - (1.0 - margin) * limit).clamp(min=0.0)


def _heading(quat_wxyz: Tensor) -> Tensor:
    """Direction of the x axis seen from above, rad, of orientations [..., 4]."""
    w, x, y, z = quat_wxyz.unbind(-1)
    return (2.0 * (w * z + x * y)).atan2(1.0 - 2.0 * (y * y + z * z))


@cost("(h_base - h_des)²", "m²", of_paper=True, of_state=True)
def base_height(step: Transition) -> Tensor:
    """Table 1; h_des is the pelvis height of the reference."""
    return (step.state.qpos[:, 2] - step.reference.qpos[:, 2]).square()


@cost("‖ω_base,xy‖²", "(rad/s)²", of_paper=True, of_state=True)
def ang_vel_xy(step: Transition) -> Tensor:
    """Table 1: roll and pitch rate in the base frame."""
    return step.state.qvel[:, 3:5].square().sum(dim=-1)


@cost("v_base,z²", "(m/s)²", of_paper=True, of_state=True)
def lin_vel_z(step: Transition) -> Tensor:
    """Table 1: vertical velocity in the base frame."""
    return step.instant.base_lin_vel_b[:, 2].square()


@cost(
    "(1/N) Σ_i [max(0, q_i - q_max,i + Δ⁺_i)² + max(0, q_min,i - q_i + Δ⁻_i)²], "
    "Δ⁺_i = ε (q_max,i - q_mid,i), Δ⁻_i = ε (q_mid,i - q_min,i)",
    "rad²",
    of_paper=True,
    of_state=True,
)
def dof_pos_limits(step: Transition, *, margin: float) -> Tensor:
    """Squared intrusion into the margin inside both joint limits, mean over joints, rad^2.

    Table 1, read so that the margin lies inside the limit: it begins ``margin`` times half the
    range before each end (q_nominal is the midpoint).
    """
    return _outside_range(step, margin).square().mean(dim=-1)


@cost("(1/N) Σ_i max(0, |q̇_i| - (1 - ε) q̇_max,i)²", "(rad/s)²", of_paper=True, of_state=True)
def dof_vel_limits(step: Transition, *, margin: float) -> Tensor:
    """Joint speeds near what the motors reach (Table 1)."""
    return _excess(step.state.qvel[:, 6:], step.limits.velocity_rad_s, margin).square().mean(dim=-1)


@cost("Σ_i (a_i,t - a_i,t-1)²", "1", of_paper=True)
def action_smoothness(step: Transition) -> Tensor:
    """Change of the raw action (Figure 14; ASAP's action rate)."""
    return (step.action - step.previous_action).square().sum(dim=-1)


@cost("(1/N) Σ_i max(0, |τ_i| - (1 - ε) τ_max,i)²", "(N m)²", of_paper=True)
def torque_limits(step: Transition, *, margin: float) -> Tensor:
    """Torques near what the motors give (Table 1)."""
    return _excess(step.state.joint_torque, step.limits.effort_nm, margin).square().mean(dim=-1)


@cost("Σ_i τ_i²", "(N m)²")
def torques(step: Transition) -> Tensor:
    """ASAP's."""
    return step.state.joint_torque.square().sum(dim=-1)


@cost("1 where the step ended the episode by a failure, else 0", "1")
def termination(step: Transition) -> Tensor:
    """ASAP's."""
    return step.terminated.to(step.state.qpos.dtype)


@cost("Σ_i [max(0, q_i - q_max,i + Δ_i) + max(0, q_min,i - q_i + Δ_i)]", "rad", of_state=True)
def dof_pos_excess(step: Transition, *, margin: float) -> Tensor:
    """ASAP's form of ``dof_pos_limits``: linear, and summed over the joints."""
    return _outside_range(step, margin).sum(dim=-1)


@cost("Σ_i min(1, max(0, |q̇_i| - (1 - ε) q̇_max,i))", "rad/s", of_state=True)
def dof_vel_excess(step: Transition, *, margin: float) -> Tensor:
    """ASAP's form of ``dof_vel_limits``: linear, at most 1 rad/s for each joint, summed."""
    excess = _excess(step.state.qvel[:, 6:], step.limits.velocity_rad_s, margin)
    return excess.clamp(max=1.0).sum(dim=-1)


@cost("Σ_i max(0, |τ_i| - (1 - ε) τ_max,i)", "N m")
def torque_excess(step: Transition, *, margin: float) -> Tensor:
    """ASAP's form of ``torque_limits``: linear, and summed over the joints."""
    return _excess(step.state.joint_torque, step.limits.effort_nm, margin).sum(dim=-1)


@cost("Σ_feet ‖g_foot,xy‖", "1", of_state=True)
def feet_orientation(step: Transition) -> Tensor:
    """Tilt of the feet: the part of gravity's direction along each sole (ASAP)."""
    w, x, y, z = step.state.body_quat_w[:, step.spec.feet].unbind(-1)
    forward, sideways = 2.0 * (w * y - x * z), 2.0 * (w * x + y * z)
    return (forward.square() + sideways.square()).sqrt().sum(dim=-1)


@cost("Σ_feet |ψ_foot - ψ_base|", "rad", of_state=True)
def feet_heading(step: Transition) -> Tensor:
    """How far the feet, seen from above, point elsewhere than the pelvis (ASAP)."""
    base = _heading(step.state.qpos[:, 3:7])[:, None]
    turned = _heading(step.state.body_quat_w[:, step.spec.feet]) - base
    return ((turned + math.pi).remainder(2.0 * math.pi) - math.pi).abs().sum(dim=-1)


@cost("Σ_feet ‖v_foot‖ [‖F_foot‖ > 1 N]", "m/s")
def slippage(step: Transition) -> Tensor:
    """Speed of the feet that touch something (ASAP)."""
    touching = step.state.foot_contact_force.norm(dim=-1) > 1.0
    return (step.state.body_lin_vel_w[:, step.spec.feet].norm(dim=-1) * touching).sum(dim=-1)


COSTS = tuple(name for name, term in TERMS.items() if term.is_cost)
STATE_COSTS = tuple(name for name, term in TERMS.items() if term.of_state)
PAPER_LOWER_LAYER = tuple(name for name, term in TERMS.items() if term.of_paper)
