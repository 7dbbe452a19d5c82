"""A study as a comparison of two arms: the numbers that claims and tables are made of."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy import stats

from analysis.data.study import BASELINE_METHOD, Study, StudyError, pretty_arm
from analysis.measures.quantities import Quantity, quantity
from analysis.measures.rollouts import Rollouts, rollouts
from analysis.statistics.autocorrelation import autocorrelation
from analysis.statistics.comparison import Comparison, compare
from analysis.statistics.intervals import relative_improvement_interval
from analysis.statistics.paper import PaperAnalysis, paper_analysis
from analysis.statistics.results import Array, Interval
from tlr_exp import keys
from tlr_exp.errors import UserError
from tlr_exp.keys import ITERATION

BODIES = (keys.TRAIN_UPPER_BODY_ERROR, keys.TRAIN_LOWER_BODY_ERROR)
PREFERRED_TREATMENT = "gwo"
SEED = 0  # of the draws that tests of many seeds need
MOST_AUTOCORRELATION = 0.999
_CORRECTIONS = 20  # after which the autocorrelation changes no more, unless the curves are short

Limits = tuple[float, float]


class Evidence:
    """The baseline arm of a study against one other arm.

    Args:
        study: the study.
        treatment: the other arm; by default the paper's method, else the first that is left.

    Raises:
        StudyError: the study has one arm only, or not this one.
    """

    def __init__(self, study: Study, treatment: str | None = None) -> None:
        others = study.arms[1:]
        if not others:
            raise StudyError(
                f"the study has one arm only, {study.baseline}: there is no comparison"
            )
        if treatment is None:
            treatment = PREFERRED_TREATMENT if PREFERRED_TREATMENT in others else others[0]
        study.seeds(treatment)  # names the arms if there is no such one
        self.study, self.baseline, self.treatment = study, study.baseline, treatment

    @property
    def is_the_papers(self) -> bool:
        """Whether this is the comparison of the paper: its method against static weights."""
        return (self.baseline, self.treatment) == (BASELINE_METHOD, PREFERRED_TREATMENT)

    @property
    def labels(self) -> tuple[str, str]:
        """The names of both arms for readers."""
        return pretty_arm(self.baseline), pretty_arm(self.treatment)

    @property
    def versus(self) -> str:
        """Both arms for a title, the treatment first."""
        baseline, treatment = self.labels
        return f"{treatment} against {baseline}"

    def has(self, metric: str) -> bool:
        """Whether there is an iteration in which every run of both arms has the metric."""
        if metric not in self.study.metric_names:
            return False
        runs = self.study.runs["arm"].isin([self.baseline, self.treatment])
        rows = self.study.curves[self.study.curves["arm"].isin([self.baseline, self.treatment])]
        return bool((rows.groupby(ITERATION)[metric].count() == runs.sum()).any())

    @property
    def paired(self) -> bool:
        """Whether both arms have the same seeds."""
        return self.study.seeds(self.baseline) == self.study.seeds(self.treatment)

    @property
    def control_steps_per_run(self) -> float:
        """The fewest control steps that a run of the two arms has taken."""
        runs = self.study.runs
        return float(
            runs.loc[runs["arm"].isin([self.baseline, self.treatment]), "control_steps"].min()
        )

    def curves(self, metric: str) -> tuple[Array, Array]:
        """Baseline [n, T] and treatment [m, T] over the iterations that every run has.

        Raises:
            StudyError: no such metric, or no common iteration.
        """
        _, first, second = self.common(metric)
        return first, second

    def common(self, metric: str) -> tuple[np.ndarray, Array, Array]:
        """Common iterations [T], and the curves of `curves`."""
        _, first_at, first = self.study.matrix(metric, self.baseline)
        _, second_at, second = self.study.matrix(metric, self.treatment)
        at = np.intersect1d(first_at, second_at)
        if at.size == 0:
            raise StudyError(f"{metric}: no iteration in which all runs of both arms have it")
        return at, first[:, np.isin(first_at, at)], second[:, np.isin(second_at, at)]

    def treatment_curve(self, metric: str) -> Array:
        """The treatment's curves [m, T]."""
        return self.study.matrix(metric, self.treatment)[2]

    def treatment_sum(self, metric: str) -> float:
        """The sum of a metric over all runs of the treatment, wherever it was measured; else 0."""
        if metric not in self.study.metric_names:
            return 0.0
        curves = self.study.curves
        return float(np.nansum(curves.loc[curves["arm"] == self.treatment, metric].to_numpy()))

    def paper_protocol(self, metric: str) -> PaperAnalysis:
        """The paper's own analysis of a metric.

        Raises:
            StudyError: as `curves`, or a baseline that is not positive, of which no share exists.
        """
        curves, better = self.curves(metric), not quantity(metric).larger_is_better
        try:
            return paper_analysis(*curves, smaller_is_better=better)
        except ValueError as error:
            raise StudyError(f"{metric}, {self.baseline}: {error}") from error

    def relative_improvement(self, metric: str) -> Interval:
        """Of the mean over training, the seed as the unit; a share, positive is better."""
        first, second = (values.mean(axis=1) for values in self.curves(metric))
        better = not quantity(metric).larger_is_better
        return relative_improvement_interval(first, second, smaller_is_better=better)

    def improvement_by_seed(self, metric: str) -> Array:
        """Each treatment run's mean over training against the baseline's: a share [m].

        Against the run of the same seed where the arms share their seeds, else against the mean.
        """
        first, second = (values.mean(axis=1) for values in self.curves(metric))
        reference = first if self.paired else first.mean()
        change = (reference - second) / reference
        return -change if quantity(metric).larger_is_better else change

    def improvement_limits(self, metric: str, confidence: float = 0.95) -> Limits | None:
        """Where the improvement of one more run of both arms is expected, as shares.

        Of arms that share their seeds from `improvement_by_seed`; else both runs are new, and the
        ratio of their means over training varies with either (first-order propagation,
        Satterthwaite's degrees of freedom). None with a single seed.
        """
        if self.paired:
            by_seed = self.improvement_by_seed(metric)
            return prediction_limits(by_seed, confidence) if by_seed.size > 1 else None
        first, second = (values.mean(axis=1) for values in self.curves(metric))
        if min(first.size, second.size) < 2:
            return None
        ratio = second.mean() / first.mean()
        parts = np.array([ratio**2 * first.var(ddof=1), second.var(ddof=1)])
        parts *= 1 + 1 / np.array([first.size, second.size])
        freedom = parts.sum() ** 2 / (parts**2 / [first.size - 1, second.size - 1]).sum()
        reach = stats.t.ppf((1 + confidence) / 2, freedom) * np.sqrt(parts.sum()) / first.mean()
        change = ratio - 1 if quantity(metric).larger_is_better else 1 - ratio
        return float(change - reach), float(change + reach)

    @cached_property
    def rollouts(self) -> Rollouts | None:
        """Measures without exploration noise, of every run; None where there are none."""
        return rollouts(self.study)

    @cached_property
    def rollouts_with_terms(self) -> Rollouts | None:
        """The same from roll-outs in which the terms of the lower layer were measured, too."""
        return rollouts(self.study, with_terms=True)

    def compare(
        self, baseline: Array, treatment: Array, shown: Quantity, paired: bool
    ) -> Comparison:
        """All that the seeds can say, of one number per seed [n] and [m]."""
        return compare(
            baseline,
            treatment,
            smaller_is_better=not shown.larger_is_better,
            generator=np.random.default_rng(SEED),
            paired=paired,
        )


def prediction_limits(values: Array, confidence: float = 0.95) -> Limits:
    """Where one further value is expected, from values [n] of a normal distribution.

    mean ± t_{n-1} s sqrt(1 + 1/n) (Hahn and Meeker, Statistical Intervals, section 3.5).

    Raises:
        ValueError: fewer than two values.
    """
    if values.size < 2:
        raise UserError(f"a prediction needs at least two values, got {values.size}")
    reach = stats.t.ppf((1 + confidence) / 2, values.size - 1)
    half = float(reach * values.std(ddof=1) * np.sqrt(1 + 1 / values.size))
    return float(values.mean()) - half, float(values.mean()) + half


@dataclass(frozen=True)
class SeedNoise:
    """How curves of one arm scatter, for simulated studies that resemble a real one.

    Attributes:
        autocorrelation: of neighbouring iterations around a run's own level, mean over runs.
        between_seed_sd: standard deviation of the runs' levels, in units of the noise around them.
    """

    autocorrelation: float
    between_seed_sd: float


def seed_noise(*arms: Array) -> SeedNoise:
    """The scatter of curves [n, T] of each arm around the arm's own mean curve.

    A run's level is the mean over training of its distance from the mean curve; the rest is noise.
    The mean of T dependent values varies by itself, with `_variance_of_mean` of the variance of the
    noise. So much of what the levels scatter is none of theirs, and is missing in the noise around
    them, in its variance as in its autocovariance. One run alone has no scatter: its level is 0,
    and its noise that around its own mean.
    """
    distance = np.concatenate([_from_mean_curve(values) for values in arms])
    levels = distance.mean(axis=1)
    noise = distance - levels[:, None]
    size = float(noise.var())
    if size == 0.0 or noise.shape[1] < 3:
        return SeedNoise(0.0, 0.0)
    neighbours = [autocorrelation(row)[1] for row in noise if np.ptp(row) > 0]
    found = rho = float(np.clip(np.mean(neighbours), 0.0, MOST_AUTOCORRELATION))
    for _ in range(_CORRECTIONS):
        lost = _variance_of_mean(rho, noise.shape[1])
        rho = min(found * (1 - lost) + lost, MOST_AUTOCORRELATION)
    lost = _variance_of_mean(rho, noise.shape[1])
    between = max(0.0, float(levels.var()) / size * (1 - lost) - lost)
    return SeedNoise(rho, float(np.sqrt(between)))


def _variance_of_mean(rho: float, length: int) -> float:
    """Variance of the mean of a stationary AR(1) series of variance 1: a share of that."""
    lags = np.arange(1, length)
    return float(1 + 2 * ((1 - lags / length) * rho**lags).sum()) / length


def _from_mean_curve(values: Array) -> Array:
    if len(values) == 1:
        return values - values.mean()
    # Of n runs, the distance from their own mean is too short by sqrt((n - 1) / n).
    return (values - values.mean(axis=0)) * np.sqrt(len(values) / (len(values) - 1))
