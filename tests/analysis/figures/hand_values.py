"""Studies whose numbers are given by the test, so that figures can be checked by hand."""

from dataclasses import replace

import numpy as np
from studies import make_study

from analysis.data.study import Study


def flat_study(arms=("fixed", "gwo"), seeds=(0, 1), iterations=4, **given) -> Study:
    """A study without noise or spread; ``with_values`` puts numbers in."""
    return make_study(
        np.random.default_rng(0),
        arms,
        seeds,
        iterations,
        seed_spread=0.0,
        noise=0.0,
        **given,
    )


def with_values(study: Study, metric: str, **values) -> Study:
    """The study with a metric of the arms named set to [seeds, iterations], or what broadcasts."""
    curves = study.curves.copy()
    if metric not in curves:
        curves[metric] = np.nan
    for arm, given in values.items():
        seeds = study.seeds(arm)
        matrix = np.broadcast_to(np.asarray(given, float), (len(seeds), study.iterations))
        for seed, row in zip(seeds, matrix, strict=True):
            rows = (curves["arm"] == arm) & (curves["seed"] == seed)
            curves.loc[rows, metric] = row
    return replace(study, curves=curves)


def without(study: Study, *metrics: str) -> Study:
    """The study without some metrics."""
    return replace(study, curves=study.curves.drop(columns=list(metrics)))


def line_of(axes, label: str) -> np.ndarray:
    """The data [2, T] of the one line with this label."""
    (line,) = [line for line in axes.lines if line.get_label() == label]
    return np.asarray(line.get_data(), dtype=float)


def texts_of(figure) -> str:
    """All words of a figure: titles, labels, annotations and legends."""
    from matplotlib.text import Text

    return "\n".join(text.get_text() for text in figure.findobj(Text))
