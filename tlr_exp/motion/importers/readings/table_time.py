"""Reads a table's rate from a column of times or of frames' numbers."""

import numpy as np

from tlr_exp.motion.importers.raw import MotionFileError

_UNEVEN = 0.1  # share of the step by which times may be off: they are often rounded


def rate_of_steps(steps: np.ndarray, what: str) -> float | None:
    """Frames a second, from times in seconds [T]; None where the rows are only counted.

    Raises:
        MotionFileError: the column does not rise evenly, or by neither counts nor seconds.
    """
    rises = np.diff(steps)
    if not len(rises):
        return None
    step = float(np.median(rises))
    if step <= 0 or np.abs(rises - step).max() > _UNEVEN * step + 1e-9:
        worst = int(np.abs(rises - step).argmax())
        raise MotionFileError(
            f"{what} does not rise evenly: by {rises[worst]:g} at row {worst + 1}, elsewhere by "
            f"{step:g}; expected times, or numbers of frames"
        )
    if (rises == 1).all():
        return None
    if step >= 1:
        raise MotionFileError(
            f"{what} rises by {step:g} a row, which is neither seconds nor one frame; give --fps"
        )
    # The ends are far apart, so that rounded times do not matter.
    rate = len(rises) / float(steps[-1] - steps[0])
    return round(rate) if abs(rate - round(rate)) < 1e-3 * rate else rate
