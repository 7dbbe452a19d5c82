"""Sigmas of tracking terms that shrink with the tracking error.

A term exp(-e/σ) tells errors apart that are about as large as σ. PBHC (KungfuBot, Xie et al. 2025)
therefore lets σ follow the error: σ <- min(σ, ē), with ē an exponential moving average of the mean
error, so that it only ever shrinks. The temperature of a term is a constant of it, and belongs to
the environment; one that adapts is part of the simulation's state.
"""

from collections.abc import Mapping

import torch
from torch import Tensor


class Temperatures:
    """The sigmas of some terms of the form exp(-e/σ), which follow the mean error over the robots.

    Args:
        sigmas: the first sigma of each term, in the units of its error; the averages begin there.
        rate: of the moving averages, per control step; PBHC has 0.001.
        device: where the terms are computed.

    Attributes:
        names: of the terms.
        sigma, error: sigmas and averages now, [n].
    """

    def __init__(self, sigmas: Mapping[str, float], rate: float, device: torch.device) -> None:
        self.names, self.rate = tuple(sigmas), rate
        self.first = torch.tensor(list(sigmas.values()), dtype=torch.float32, device=device)
        self.sigma, self.error = self.first, self.first

    def constants(self) -> dict[str, dict[str, Tensor]]:
        """What the terms are to be computed with now, by name."""
        return {name: {"sigma": sigma} for name, sigma in zip(self.names, self.sigma, strict=True)}

    def update(self, values: Tensor) -> None:
        """Take in the terms of one control step [num_envs, n], computed with the first sigmas."""
        # The error is taken back from the term. With the first sigma, for by one that has shrunk a
        # robot that is far off would have a term of 0, which says only that its error is large; so
        # it does beyond 87 first sigmas.
        errors = -self.first * values.clamp(min=torch.finfo(values.dtype).tiny).log()
        self.error = torch.lerp(self.error, errors.mean(dim=0), self.rate)
        self.sigma = torch.minimum(self.sigma, self.error)

    def state_dict(self) -> dict[str, Tensor]:
        return {"sigma": self.sigma, "error": self.error}

    def load_state_dict(self, state: Mapping[str, Tensor]) -> None:
        self.sigma, self.error = (state[name].to(self.sigma) for name in ("sigma", "error"))
