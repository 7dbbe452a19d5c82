"""Where in the motion episodes start: at one frame, anywhere, or where episodes fail.

``adaptive`` follows BeyondMimic (section III-F; its published code): the motion is cut into bins,
failures are counted in the bin in which they happen, and starts are drawn where they are many.
"""

import math
from collections.abc import Sequence

import torch
from torch import Tensor

from tlr_exp.config.limits import check_starts
from tlr_exp.errors import UserError

# As in BeyondMimic's code. A second is about the time from a mistake to a fall: shorter bins would
# hold too few failures to compare, longer ones would repeat more than what went wrong.
BIN_S = 1.0
UNIFORM_SHARE = 0.1  # of the starts, drawn evenly: no part of the motion is given up
AVERAGING_RATE = 0.001  # of the moving average, a control step: about the last 20 s count
# What a failure adds to its own bin and to those before it: it is caused by what came before. The
# decay is BeyondMimic's 0.8 a bin; three bins reach two seconds back.
KERNEL = (1.0, 0.8, 0.64)


def even_frames(num_starts: int, count: int, key: str) -> list[int]:
    """``count`` of the frames 0 .. num_starts - 1 in which an episode can start, evenly, 0 first.

    Raises:
        ValueError: there are fewer than that; ``key`` says where the count comes from.
    """
    check_starts(key, count, num_starts)
    return [number * num_starts // count for number in range(count)]


class StartFrames:
    """Draws the frames in which episodes start.

    Args:
        choice: ``zero``, ``random`` or ``adaptive`` (the key ``env.start_phase``).
        num_starts: an episode starts in one of the frames 0 .. num_starts - 1.
        fps: frames a second.
        device: where frames are drawn.

    Attributes:
        failures: moving average of the failures a control step in each bin, [num_bins].
    """

    def __init__(self, choice: str, num_starts: int, fps: float, device: torch.device) -> None:
        self.choice = choice
        self.num_starts = num_starts
        self.device = device
        num_bins = max(1, round(num_starts / (BIN_S * fps)))
        # Whole frames, so that bins may differ by one frame.
        bounds = torch.arange(num_bins + 1, device=device) * num_starts // num_bins
        self._first, self._sizes = bounds[:-1], bounds.diff()
        self._bin_of_frame = torch.arange(num_bins, device=device).repeat_interleave(self._sizes)
        self.failures = torch.zeros(num_bins, device=device)
        self.keep_within(None)

    def keep_within(self, phases: Sequence[float] | None) -> None:
        """Draw ``random`` starts between two shares of the motion from now on; None: anywhere.

        Args:
            phases: the first and the last, from 0 to 1; twice the same is one frame.
        """
        first, last = phases or (0.0, 1.0)
        self._earliest = min(int(first * self.num_starts), self.num_starts - 1)
        self._choices = max(1, math.ceil(last * self.num_starts) - self._earliest)

    def draw(self, count: int, generator: torch.Generator) -> Tensor:
        """Frames in which ``count`` episodes start, [count] int64."""
        if self.choice == "zero":
            return torch.zeros(count, dtype=torch.int64, device=self.device)
        if self.choice == "random":
            draw = torch.randint(self._choices, (count,), generator=generator, device=self.device)
            return self._earliest + draw
        bins = torch.multinomial(self.probabilities(), count, replacement=True, generator=generator)
        within = torch.rand(count, generator=generator, device=self.device)
        return self._first[bins] + (within * self._sizes[bins]).long()

    def checked(self, frames: Sequence[int], count: int) -> Tensor:
        """Frames that somebody has chosen for ``count`` robots, [count] int64.

        Raises:
            UserError: not one frame for each robot, or no episode can start there.
        """
        if len(frames) != count or not all(0 <= frame < self.num_starts for frame in frames):
            raise UserError(
                f"start frames are {list(frames)}; needed are {count}, one for each robot, from 0 "
                f"to {self.num_starts - 1}"
            )
        return torch.tensor(frames, dtype=torch.int64, device=self.device)

    def probabilities(self) -> Tensor:
        """Of each bin to be drawn from by ``adaptive``, [num_bins]; even before any failure.

        Only the proportions between bins count, so the last failures keep their weight until
        others come.
        """
        even = self._sizes / self.num_starts
        caused = torch.zeros_like(self.failures)
        for age, weight in enumerate(KERNEL[: len(caused)]):
            caused[: len(caused) - age] += weight * self.failures[age:]
        total = caused.sum()
        # Without a failure, or with none for so long that it fades out of float32's range: evenly.
        tiny = torch.finfo(total.dtype).tiny
        share = torch.where(total > tiny, caused / total.clamp(min=tiny), even)
        return UNIFORM_SHARE * even + (1.0 - UNIFORM_SHARE) * share

    def update(self, frame: Tensor, failed: Tensor) -> None:
        """Take in one control step.

        Args:
            frame: [num_envs] int64, where in the motion each episode is; beyond the last start
                counts for the last bin.
            failed: [num_envs] bool, the episodes that ended there by a failure.
        """
        if self.choice != "adaptive":
            return
        bins = self._bin_of_frame[frame.clamp(max=self.num_starts - 1)]
        counts = torch.zeros_like(self.failures).index_add(0, bins, failed.to(self.failures))
        self.failures = self.failures + AVERAGING_RATE * (counts - self.failures)

    def state_dict(self) -> dict[str, Tensor]:
        return {"failures": self.failures}

    def load_state_dict(self, state: dict[str, Tensor]) -> None:
        """Continue from ``state_dict``.

        Raises:
            ValueError: saved with a motion of another length.
        """
        found = state["failures"]
        if found.shape != self.failures.shape:
            raise UserError(
                f"the saved start phases have {len(found)} bins, this motion has "
                f"{len(self.failures)}: they were saved with another motion"
            )
        self.failures = found.to(self.device)
