"""Policies with two or a few parameters, whose objectives are known: what rivals are told of."""

from dataclasses import dataclass

import torch
from torch import Tensor

from tlr_exp.optimizer.protocol import PolicyGradients, TrainingProgress, WeightUpdate


@dataclass(frozen=True)
class Stated:
    """Gradients as a test states them; a step takes `curvature` times itself off the goal's."""

    goal: Tensor
    terms: Tensor
    curvature: float | Tensor = 0.0
    parts: tuple["Stated", "Stated"] | None = None

    def goal_after(self, step: Tensor) -> Tensor:
        return self.goal - self.curvature * step

    def halves(self) -> tuple["Stated", "Stated"]:
        return self.parts or (self, self)


def random_gradients(seed: int, num_terms: int) -> Stated:
    """Some gradients, and others in each of their halves."""
    generator = torch.Generator().manual_seed(seed)

    def draw(*shape: int) -> Tensor:
        return torch.randn(*shape, 7, generator=generator)

    first, second = (Stated(draw(), draw(num_terms), curvature=0.5) for _ in range(2))
    goal, terms = (first.goal + second.goal) / 2, (first.terms + second.terms) / 2
    return Stated(goal, terms, 0.5, (first, second))


def costs(num_terms: int) -> dict[str, float]:
    return {f"cost{num}": 1.0 for num in range(num_terms)}


def asked(optimizer, gradients: PolicyGradients) -> WeightUpdate:
    """The weights of an iteration in which the policy has these gradients."""
    num_terms = len(gradients.terms)
    optimizer.observe(
        TrainingProgress(
            mean_episode_length=50.0,
            num_steps=24,
            mean_terms=costs(num_terms),
            policy_gradients=lambda: gradients,
        )
    )
    goal_return = torch.arange(20.0)
    return optimizer.update(goal_return, -torch.ones(20, num_terms))
