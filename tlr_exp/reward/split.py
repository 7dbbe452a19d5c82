"""The two-layered reward: a fixed goal part and an optimizing part whose weights are adapted.

The environment records raw term values. Everything that turns them into a reward (coefficient,
control step, weight) happens here, after the collection.
"""

import math
from collections.abc import Mapping

import torch
from torch import Tensor

from tlr_exp import keys


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

    Attributes:
        term_names: goal terms, then optimizing terms: the last axis of the raw reward terms.
        goal_names: the goal terms, in the order given.
        optimizing_names: the optimizing terms, in the order given: the axis of the weights.
        control_dt_s: duration of one control step, seconds.

    Raises:
        ValueError: an unknown term, a term in both groups, no goal term, a coefficient that is
            not a finite number, or a control step that is not positive.
    """

    def __init__(
        self,
        goal: Mapping[str, float],
        optimizing: Mapping[str, float],
        control_dt_s: float,
    ) -> None:
        goal_coefficients = _checked_group("goal", goal)
        optimizing_coefficients = _checked_group("optimizing", optimizing)
        if not goal_coefficients:
            raise ValueError(
                "reward group 'goal' is empty: it needs at least one term, because trajectories "
                f"are ranked by the goal reward. Available terms: {list(keys.TERM_NAMES)}"
            )
        shared = [name for name in goal_coefficients if name in optimizing_coefficients]
        if shared:
            raise ValueError(
                f"reward terms {shared} are in both groups: remove each from 'goal' or from "
                "'optimizing'"
            )
        self.control_dt_s = _finite_number("control_dt_s", control_dt_s)
        if self.control_dt_s <= 0.0:
            raise ValueError(f"control_dt_s must be positive seconds, got {control_dt_s!r}")

        self.goal_names: tuple[str, ...] = tuple(goal_coefficients)
        self.optimizing_names: tuple[str, ...] = tuple(optimizing_coefficients)
        self.term_names: tuple[str, ...] = self.goal_names + self.optimizing_names
        values = [*goal_coefficients.values(), *optimizing_coefficients.values()]
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
        num_goal = len(self.goal_names)
        return per_term[:, :num_goal].sum(dim=1), per_term[:, num_goal:]

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
            raise ValueError(
                f"weights have shape {tuple(weights.shape)}, expected ({num_optimizing},): one "
                f"for each optimizing term {list(self.optimizing_names)}"
            )
        scale = self._coefficients_like(reward_terms).clone()
        scale[len(self.goal_names) :] *= weights.to(reward_terms)
        return (reward_terms * scale).sum(dim=-1, keepdim=True)

    def layers(self, mean_terms: Mapping[str, float]) -> tuple[float, float]:
        """What a second with these raw terms brings, layer by layer, at weights 1.

        Args:
            mean_terms: raw value of each term by name, of this split's terms at least.

        Returns:
            the goal reward, and the cost of the lower layer: what it takes from that.
        """
        shares = {name: value * mean_terms[name] for name, value in self._per_second().items()}
        goal = sum(shares[name] for name in self.goal_names)
        cost = -sum(shares[name] for name in self.optimizing_names)
        return float(goal), float(cost)

    def goal_share(self, mean_terms: Mapping[str, float]) -> float:
        """The goal reward of these raw terms as a share of that of perfect tracking.

        There every tracking term is 1, and every term that is taken off is 0.
        """
        perfect = {name: float(value > 0.0) for name, value in self._per_second().items()}
        return self.layers(mean_terms)[0] / self.layers(perfect)[0]

    def _per_second(self) -> dict[str, float]:
        """The coefficient of each term."""
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
            raise ValueError(
                f"reward_terms have shape {tuple(reward_terms.shape)}, expected "
                f"[num_envs, num_steps, {num_terms}] with the terms {list(self.term_names)}"
            )
        if not reward_terms.is_floating_point():
            raise ValueError(f"reward_terms must be floating point, got {reward_terms.dtype}")


def _checked_group(group: str, coefficients: Mapping[str, float]) -> dict[str, float]:
    """The group as a plain dict of floats; unknown names and bad numbers are refused."""
    unknown = [name for name in coefficients if name not in keys.TERM_NAMES]
    if unknown:
        raise ValueError(
            f"unknown reward terms {unknown} in group '{group}'. "
            f"Available terms: {list(keys.TERM_NAMES)}"
        )
    return {
        str(name): _finite_number(f"coefficient {group}.{name}", value)
        for name, value in coefficients.items()
    }


def _finite_number(what: str, value: object) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise ValueError(f"{what} must be a finite number, got {value!r}")
    return float(value)
