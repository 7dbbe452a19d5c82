"""The two-layered reward: a fixed goal part and an optimizing part whose weights are adapted.

The environment records raw term values. Everything that turns them into a reward (coefficient,
control step, weight) happens here, after the collection.
"""

import math
from collections.abc import Iterable, Mapping

import torch
from torch import Tensor

from tlr_exp.errors import UserError


class RewardSplit:
    """Which terms form the goal reward r_g, which the optimizing reward r_o, and how strongly.

    The reward of one control step is, with raw term values r_k and coefficients c_k,

        r = control_dt_s * (sum over goal terms of c_k r_k
                            + sum over optimizing terms of w_i c_i r_i).

    The weights w_i belong to the optimizing terms alone. A penalty has a negative coefficient.

    Args:
        goal: coefficient of each goal term, per second. At least one term.
        optimizing: coefficient of each optimizing term, per second. May be empty.
        control_dt_s: duration of one control step, seconds.
        term_names: the terms that are recorded, in the order of the last axis of the raw values;
            those of both groups, wherever they stand, and any others, which bring nothing.

    Attributes:
        term_names: as given.
        goal_names: the goal terms, in the order given.
        optimizing_names: the optimizing terms, in the order given: the axis of the weights.
        control_dt_s: duration of one control step, seconds.

    Raises:
        UserError: a term that is not recorded, a term in both groups, no goal term, a coefficient
            that is not a finite number, or a control step that is not positive.
    """

    def __init__(
        self,
        goal: Mapping[str, float],
        optimizing: Mapping[str, float],
        control_dt_s: float,
        term_names: Iterable[str],
    ) -> None:
        self.term_names = tuple(term_names)
        goal_coefficients = _checked_group("goal", goal, self.term_names)
        optimizing_coefficients = _checked_group("optimizing", optimizing, self.term_names)
        if not goal_coefficients:
            raise UserError(
                "reward group 'goal' is empty: it needs at least one term, because trajectories "
                f"are ranked by the goal reward. Recorded terms: {list(self.term_names)}"
            )
        shared = [name for name in goal_coefficients if name in optimizing_coefficients]
        if shared:
            raise UserError(
                f"reward terms {shared} are in both groups: remove each from 'goal' or from "
                "'optimizing'"
            )
        self.control_dt_s = _finite_number("control_dt_s", control_dt_s)
        if self.control_dt_s <= 0.0:
            raise UserError(f"control_dt_s must be positive seconds, got {control_dt_s!r}")

        self.goal_names: tuple[str, ...] = tuple(goal_coefficients)
        self.optimizing_names: tuple[str, ...] = tuple(optimizing_coefficients)
        self._goal = [self.term_names.index(name) for name in self.goal_names]
        self._optimizing = [self.term_names.index(name) for name in self.optimizing_names]
        coefficients = goal_coefficients | optimizing_coefficients
        values = [coefficients.get(name, 0.0) for name in self.term_names]
        # Multiplied in double precision once, so that every dtype gets the nearest product.
        self._coefficients = torch.tensor(values, dtype=torch.float64) * self.control_dt_s
        self._cache: dict[tuple[torch.device, torch.dtype], Tensor] = {}

    def returns(self, reward_terms: Tensor) -> tuple[Tensor, Tensor]:
        """Undiscounted returns of each environment's trajectory.

        Args:
            reward_terms: raw values [num_envs, num_steps, num_terms], in order of `term_names`.

        Returns:
            goal_return [num_envs], r_g of each trajectory, and term_returns
            [num_envs, num_optimizing], the signed share of each optimizing term at weight 1, so
            that the total return at weights w is `goal_return + term_returns @ w`.

        Raises:
            ValueError: the shape does not fit the terms of this split.
        """
        self._check_reward_terms(reward_terms)
        per_term = reward_terms.sum(dim=1) * self._coefficients_like(reward_terms)
        return per_term[:, self._goal].sum(dim=1), per_term[:, self._optimizing]

    def rewards_apart(self, reward_terms: Tensor) -> Tensor:
        """The parts of every step's reward: `compose` at weights w is goal + terms @ w.

        Args:
            reward_terms: raw values [num_envs, num_steps, num_terms], in order of `term_names`.

        Returns:
            rewards [num_envs, num_steps, 1 + num_optimizing]: the goal reward, then the signed
            share of each optimizing term at weight 1.

        Raises:
            ValueError: the shape does not fit the terms of this split.
        """
        self._check_reward_terms(reward_terms)
        per_term = reward_terms * self._coefficients_like(reward_terms)
        goal = per_term[..., self._goal].sum(dim=-1, keepdim=True)
        return torch.cat((goal, per_term[..., self._optimizing]), dim=-1)

    def compose(self, reward_terms: Tensor, weights: Tensor) -> Tensor:
        """The reward of every step at the given weights.

        Args:
            reward_terms: raw values [num_envs, num_steps, num_terms], in order of `term_names`.
            weights: weights of the optimizing terms [num_optimizing]. They are brought to the
                device and dtype of `reward_terms`.

        Returns:
            reward [num_envs, num_steps, 1].

        Raises:
            ValueError: a shape does not fit the terms of this split.
        """
        self._check_reward_terms(reward_terms)
        num_optimizing = len(self.optimizing_names)
        if weights.shape != (num_optimizing,):
            raise UserError(
                f"weights have shape {tuple(weights.shape)}, expected ({num_optimizing},): one "
                f"for each optimizing term {list(self.optimizing_names)}"
            )
        scale = self._coefficients_like(reward_terms).clone()
        scale[self._optimizing] *= weights.to(reward_terms)
        return (reward_terms * scale).sum(dim=-1, keepdim=True)

    def layers(self, mean_terms: Mapping[str, float]) -> tuple[float, float]:
        """What a second with these raw terms brings, layer by layer, at weights 1.

        Args:
            mean_terms: raw value of each term by name, of both layers' terms at least.

        Returns:
            the goal reward, and the cost of the lower layer: what it takes from that.
        """
        per_second = self._per_second()
        goal = sum(per_second[name] * mean_terms[name] for name in self.goal_names)
        cost = -sum(per_second[name] * mean_terms[name] for name in self.optimizing_names)
        return float(goal), float(cost)

    def goal_share(self, mean_terms: Mapping[str, float]) -> float:
        """The goal reward of these raw terms as a share of that of perfect tracking.

        There every tracking term is 1, and every term that is taken off is 0.
        """
        perfect = {name: float(value > 0.0) for name, value in self._per_second().items()}
        return self.layers(mean_terms)[0] / self.layers(perfect)[0]

    def _per_second(self) -> dict[str, float]:
        """The coefficient of each recorded term."""
        coefficients = (self._coefficients / self.control_dt_s).tolist()
        return dict(zip(self.term_names, coefficients, strict=True))

    def _coefficients_like(self, like: Tensor) -> Tensor:
        """Coefficient times control step [num_terms], on the device and in the dtype of `like`."""
        key = (like.device, like.dtype)
        if key not in self._cache:
            self._cache[key] = self._coefficients.to(device=like.device, dtype=like.dtype)
        return self._cache[key]

    def _check_reward_terms(self, reward_terms: Tensor) -> None:
        num_terms = len(self.term_names)
        if reward_terms.ndim != 3 or reward_terms.shape[-1] != num_terms:
            raise UserError(
                f"reward_terms have shape {tuple(reward_terms.shape)}, expected "
                f"[num_envs, num_steps, {num_terms}] with the terms {list(self.term_names)}"
            )
        if not reward_terms.is_floating_point():
            raise UserError(f"reward_terms must be floating point, got {reward_terms.dtype}")


def _checked_group(
    group: str, coefficients: Mapping[str, float], term_names: tuple[str, ...]
) -> dict[str, float]:
    """The group as a plain dict of floats; terms without values and bad numbers are refused."""
    missing = [name for name in coefficients if name not in term_names]
    if missing:
        raise UserError(
            f"nothing records the reward terms {missing} of group '{group}'. "
            f"Recorded terms: {list(term_names)}"
        )
    return {
        str(name): _finite_number(f"coefficient {group}.{name}", value)
        for name, value in coefficients.items()
    }


def _finite_number(what: str, value: object) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise UserError(f"{what} must be a finite number, got {value!r}")
    return float(value)
