"""The drawing that a figure function returns, and the words of captions about the data."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
from matplotlib.figure import Figure

from analysis.data.study import Study, pretty_arm
from analysis.figures.style import TIMES
from tlr_exp.errors import UserError


class NotDrawnError(UserError):
    """The study has not the data that a figure needs; the message is the reason, for a reader."""


@dataclass(frozen=True)
class Drawing:
    """A figure with all that a page needs beside it.

    figure: Matplotlib figure; ``style.render`` makes files of it.
    title: a few words, no full stop.
    caption: what is plotted, units, number of seeds, scale of the run, what a band is, smoothing.
    stem: name of its files without suffix.
    """

    figure: Figure
    title: str
    caption: str
    stem: str


@dataclass(frozen=True)
class FigureSpec:
    """An entry of the list of all figures.

    stem: name of its files without suffix, as in the drawing.
    paper: what it is in the paper, "Figure 7"; empty where the paper has nothing like it.
    draw: the figure function. Raises ``NotDrawnError`` where the study lacks the data.
    """

    stem: str
    paper: str = field(compare=False)
    draw: Callable[[Study], Drawing] = field(compare=False)


BAND_IS_SD = "mean ± 1 standard deviation between seeds (n - 1 in the denominator)"


def caption_of(study: Study, what: str, *, band: bool, smoothing: str = "none") -> str:
    """A caption: ``what`` is plotted, then seeds, band, scale and smoothing in fixed words.

    Args:
        study: the study whose runs are plotted.
        what: sentences that say what is plotted, with units.
        band: whether the figure shows the spread between seeds as a band (or whisker).
        smoothing: what was smoothed and how; "none" for raw values.
    """
    parts = [what, seeds_text(study)]
    if band:
        parts.append(band_text(study))
    parts.append(f"Scale: {scale_text(study)}.")
    parts.append(f"Smoothing: {smoothing}.")
    return " ".join(parts)


def seeds_text(study: Study) -> str:
    """How many seeds stand behind the figure: "n = 5 seeds per arm (0 to 4)."."""
    counts = {arm: study.seeds(arm) for arm in study.arms}
    if len(set(counts.values())) == 1:
        seeds = counts[study.baseline]
        noun = "seed" if len(seeds) == 1 else "seeds"
        return f"n = {len(seeds)} {noun} per arm ({_numbers(seeds)})."
    each = [f"{pretty_arm(arm)} {len(s)} ({_numbers(s)})" for arm, s in counts.items()]
    return f"n, seeds per arm: {'; '.join(each)}."


def band_text(study: Study) -> str:
    """What the band is, and which arms have none."""
    single = [pretty_arm(arm) for arm in study.arms if len(study.seeds(arm)) == 1]
    if len(single) == len(study.arms):
        return "No band: one seed shows no spread."
    without = f"; no band for {', '.join(single)} (one seed)" if single else ""
    return f"Lines and bands: {BAND_IS_SD}{without}."


def scale_text(study: Study) -> str:
    """Size of the runs: "laptop: 512 environments × 407 iterations".

    Says also how far the runs have come where they are not at their end.
    """
    sizes = study.runs[["scale", "num_envs", "iterations"]].drop_duplicates()
    texts = [
        f"{scale}: {num_envs} environments {TIMES} {iterations} iterations"
        for scale, num_envs, iterations in sizes.itertuples(index=False)
    ]
    reached = [int(np.max(curve["iteration"])) for _, curve in study.curves.groupby("run")]
    low, high = min(reached), max(reached)
    if low < study.iterations:
        span = f"{low}" if low == high else f"{low} to {high}"
        texts[-1] += f" (not finished: {span} of {study.iterations} iterations so far)"
    return "; ".join(texts)


def _numbers(seeds: Sequence[int]) -> str:
    """Seeds in brief: (0, 1, 2, 3, 4) -> "0 to 4", (0, 2, 7) -> "0, 2, 7"."""
    if len(seeds) > 2 and list(seeds) == list(range(seeds[0], seeds[-1] + 1)):
        return f"{seeds[0]} to {seeds[-1]}"
    return ", ".join(str(seed) for seed in seeds)
