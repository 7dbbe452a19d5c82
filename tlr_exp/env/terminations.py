"""When an episode ends by a failure (terminated); the motion's end is the environment's concern."""

import torch
from torch import Tensor

from tlr_exp.config.settings import TerminationSettings
from tlr_exp.env.instant import Instant


def fell(instant: Instant, max_tilt: float) -> Tensor:
    """True where the pelvis tilts beyond ``max_tilt``, [num_envs]."""
    return instant.gravity_b[:, :2].abs().amax(dim=-1) > max_tilt


def far_from_reference(instant: Instant, max_distance_m: float | Tensor) -> Tensor:
    """True where any tracked body is farther than ``max_distance_m`` from its reference."""
    return instant.squared_distance.amax(dim=-1) > max_distance_m**2


class TighteningDistance:
    """The distance limit of an episode, tightened as episodes get longer (ASAP's curriculum).

    The mean episode length is a running mean over about ``num_envs`` finished episodes, unless the
    settings say how many. All values are tensors, so that no step waits for the device.
    """

    def __init__(
        self,
        settings: TerminationSettings,
        num_envs: int,
        device: torch.device,
    ) -> None:
        self.settings = settings
        self.window = settings.mean_episodes or num_envs
        self.largest_m = settings.distance_max_m or settings.distance_start_m
        self.value_m = torch.tensor(settings.distance_start_m, device=device)
        self.mean_length = torch.tensor(0.0, device=device)
        self.is_held = False

    def hold(self, value_m: float | None) -> None:
        """Keep the limit at a value from now on; with None let it follow the rule from there."""
        self.is_held = value_m is not None
        if value_m is not None:
            self.value_m = torch.full_like(self.value_m, value_m)

    def update(self, lengths: Tensor, finished: Tensor) -> None:
        """Take in one control step: ``lengths`` [num_envs], ``finished`` [num_envs] bool."""
        settings = self.settings
        count = finished.sum()
        mean = (lengths * finished).sum() / count.clamp(min=1)
        count = count.clamp(max=self.window)
        self.mean_length = self.mean_length + (mean - self.mean_length) * count / self.window
        if self.is_held:
            return
        tighten = self.mean_length > settings.tighten_above_steps
        loosen = self.mean_length < settings.loosen_below_steps
        factor = 1.0 + settings.tighten_rate * (loosen.float() - tighten.float())
        self.value_m = (self.value_m * factor).clamp(settings.distance_end_m, self.largest_m)

    def state_dict(self) -> dict[str, Tensor]:
        return {"value_m": self.value_m, "mean_length": self.mean_length}

    def load_state_dict(self, state: dict[str, Tensor]) -> None:
        self.value_m = state["value_m"].to(self.value_m.device)
        self.mean_length = state["mean_length"].to(self.value_m.device)
