"""The judges of the paper's claims: our number beside the paper's, and what it says of it."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from analysis.measures.endpoints import tail_mean
from analysis.measures.quantities import EVALUATE_S, ITERATION_S, LATENCY, WEIGHTS_S
from analysis.report.cells import interval_text, p_text
from analysis.report.evidence import Evidence
from analysis.report.judging.verdicts import (
    ALPHA,
    Verdict,
    above_zero,
    agreement,
    around,
    policies_track,
)
from analysis.statistics.intervals import difference_interval
from analysis.statistics.slope import tail_change
from tlr_exp import keys
from tlr_exp.env import terms

PAPER_CONTROL_STEPS = 4096 * 24 * 2500
EARLY_SHARE = 0.2  # the first 500 of 2500 iterations, until the two-layered arm overtakes
EARLY_STEPS = EARLY_SHARE * PAPER_CONTROL_STEPS  # 49 million control steps
LONG_EPISODE_STEPS, LONG_EPISODE_SHARE = 200.0, 0.4  # above 200 steps for 1000 of 2500 iterations


@dataclass(frozen=True)
class Finding:
    """Our number beside a claim, and what it says of the claim."""

    ours: str
    verdict: Verdict
    reason: str


def improvement(metric: str, paper_percent: float) -> Callable[[Evidence], Finding]:
    """The mean relative improvement of an error over training, with the seed as the unit."""

    def judge(evidence: Evidence) -> Finding:
        interval = evidence.relative_improvement(metric)
        protocol = evidence.paper_protocol(metric)
        ours = (
            f"{interval_text(interval, 1, percent=True)}; the paper's own analysis gives "
            f"{100 * protocol.average_improvement:+.1f} %, p = {p_text(protocol.iteration_test)}"
        )
        verdict, reason = above_zero(interval, "two-layered arm is better", "static arm is better")
        if np.isfinite(interval.low):
            inside = interval.low <= paper_percent / 100 <= interval.high
            reason += f"; the paper's {paper_percent} % lies {'inside' if inside else 'outside'} it"
        return Finding(ours, verdict, reason)

    return judge


def single_run(metric: str, paper_percent: float) -> Callable[[Evidence], Finding]:
    """A single run's improvement: whether runs like ours can be expected to show the paper's."""

    def judge(evidence: Evidence) -> Finding:
        improvements = 100.0 * evidence.improvement_by_seed(metric)
        limits = evidence.improvement_limits(metric)
        if limits is None:
            said = ", ".join(f"{each:+.1f} %" for each in improvements)
            return Finding(said, Verdict.CANNOT_SAY, "a single seed")
        ours = f"{improvements.min():+.1f} to {improvements.max():+.1f} % over the seeds"
        low, high = (100.0 * limit for limit in limits)
        expected = f"one more run is expected from {low:+.1f} to {high:+.1f} % (95 %)"
        verdict, remark = agreement(low, high, paper_percent, 0.0, "no improvement")
        return Finding(ours, verdict, expected + remark)

    return judge


def _early(at: np.ndarray, evidence: Evidence) -> tuple[np.ndarray, str]:
    """Which iterations [T] lie in the part of which the paper says "at first", and in words.

    Of a training that ends with policies that track, the first fifth, as the paper's 500 of 2500
    iterations; else what lies within the control steps that these iterations took.
    """
    if policies_track(evidence):
        return at <= max(at[0], EARLY_SHARE * at[-1]), "in the first 20 % of training"
    per_iteration = evidence.control_steps_per_run / evidence.study.curves[keys.ITERATION].max()
    early = at <= max(at[0], EARLY_STEPS / per_iteration)
    part = "the whole training lies" if early.all() else f"iterations to {at[early][-1]} lie"
    return early, f"({part} within the {EARLY_STEPS / 1e6:.0f} million steps of that part)"


def longer_static_at_first(evidence: Evidence) -> Finding:
    at, *both = evidence.common(keys.EPISODE_LENGTH)
    early, when = _early(at, evidence)
    static, two_layered = (values[:, early].mean(axis=1) for values in both)
    interval = difference_interval(two_layered, static)
    ours = f"static longer by {interval_text(interval, 1)} steps {when}"
    return Finding(ours, *above_zero(interval, _STATIC_LONGER, _TWO_LAYERED_LONGER))


def tracks_better_at_first(metric: str) -> Callable[[Evidence], Finding]:
    def judge(evidence: Evidence) -> Finding:
        at, *both = evidence.common(metric)
        early, when = _early(at, evidence)
        static, two_layered = (values[:, early].mean(axis=1) for values in both)
        interval = difference_interval(static, two_layered)
        ours = f"static better by {interval_text(interval, 4)} m {when}"
        return Finding(ours, *above_zero(interval, "static arm tracks better", _TWO_LAYERED_BETTER))

    return judge


def less_latency(evidence: Evidence) -> Finding:
    """Delay behind the reference, by cross-correlation of the joints, without noise."""
    found, arms = evidence.rollouts, (evidence.baseline, evidence.treatment)
    if found is None or not found.has(evidence.study, LATENCY, *arms):
        return Finding(
            "not measured of all runs", Verdict.CANNOT_SAY, "no latency is known without noise"
        )
    known = [found.of_arm(evidence.study, LATENCY, arm) for arm in arms]
    static, two_layered = (each.to_numpy() for each in known)
    interval = difference_interval(two_layered, static)
    ours = (
        f"{two_layered.mean():.0f} ms against {static.mean():.0f} ms; less by "
        f"{interval_text(interval, 1)} ms ({found.source})"
    )
    return Finding(ours, *above_zero(interval, "two-layered arm lags less", "static arm lags less"))


def overtakes(evidence: Evidence) -> Finding:
    at, *both = evidence.common(keys.EPISODE_LENGTH)
    static, two_layered = (tail_mean(values, at) for values in both)
    interval = difference_interval(static, two_layered)
    ours = f"two-layered longer by {interval_text(interval, 1)} steps in the last 20 %"
    return Finding(ours, *above_zero(interval, _TWO_LAYERED_LONGER, _STATIC_LONGER))


def long_episodes(evidence: Evidence) -> Finding:
    at, _, two_layered = evidence.common(keys.EPISODE_LENGTH)
    share = float((two_layered.mean(axis=0) > LONG_EPISODE_STEPS).mean())
    enough = share >= LONG_EPISODE_SHARE
    verdict = Verdict.REPRODUCED if enough else Verdict.NOT_REPRODUCED
    ours = f"above {LONG_EPISODE_STEPS:.0f} steps in {100 * share:.0f} % of the iterations"
    change = tail_change(two_layered, at)
    if not enough and change.test.p_value < ALPHA and change.mean.estimate > 0:
        grown = interval_text(change.mean, 1, percent=True)
        reason = f"less than the paper's 40 %, but they still grow, by {grown} in the last fifth"
        return Finding(ours, Verdict.CANNOT_SAY, reason)
    return Finding(ours, verdict, f"{'at least' if enough else 'less than'} the paper's 40 %")


def final_weights(names: tuple[str, ...], paper: float) -> Callable[[Evidence], Finding]:
    """The last weights of some terms against the paper's: each of them, at 95 % together."""

    def judge(evidence: Evidence) -> Finding:
        known = [name for name in names if keys.WEIGHT_PREFIX + name in evidence.study.metric_names]
        if not known:
            return Finding("not in this reward", Verdict.CANNOT_SAY, "the terms are not in use")
        last = {name: evidence.treatment_curve(keys.WEIGHT_PREFIX + name)[:, -1] for name in known}
        ours = ", ".join(f"{name} {values.mean():.2f}" for name, values in last.items())
        judged = {name: around(values, paper, len(known)) for name, values in last.items()}
        if len(names) == 1:
            return Finding(ours, *judged[names[0]])
        for verdict in (Verdict.NOT_REPRODUCED, Verdict.CANNOT_SAY):
            reasons = [
                f"{name}: {why}" for name, (found, why) in judged.items() if found == verdict
            ]
            if reasons:
                return Finding(ours, verdict, "; ".join(reasons))
        if len(known) < len(names):
            absent = ", ".join(name for name in names if name not in known)
            return Finding(ours, Verdict.CANNOT_SAY, f"not in use: {absent}")
        return Finding(ours, Verdict.REPRODUCED, f"one more run is expected near {paper} in each")

    return judge


def mean_weight(name: str, paper: float) -> Callable[[Evidence], Finding]:
    def judge(evidence: Evidence) -> Finding:
        metric = keys.WEIGHT_PREFIX + name
        if metric not in evidence.study.metric_names:
            return Finding("not in this reward", Verdict.CANNOT_SAY, f"{name} is not in use")
        means = evidence.treatment_curve(metric).mean(axis=1)
        return Finding(f"{means.mean():.3f}", *around(means, paper))

    return judge


def overhead(paper_share: float) -> Callable[[Evidence], Finding]:
    def judge(evidence: Evidence) -> Finding:
        search = evidence.treatment_curve(WEIGHTS_S)
        # As in Figure 15, without the evaluations, which the paper's iterations do not have.
        training = evidence.treatment_sum(ITERATION_S)
        training -= evidence.treatment_sum(EVALUATE_S)
        share = evidence.treatment_sum(WEIGHTS_S) / training
        ours = (
            f"{search.mean():.3g} ± {search.std():.2g} s, {100 * share:.2g} % of an iteration "
            "without its evaluation"
        )
        verdict = Verdict.REPRODUCED if share <= paper_share else Verdict.NOT_REPRODUCED
        return Finding(
            ours, verdict, f"the paper's share is {100 * paper_share:.1f} %, on its machine"
        )

    return judge


_TWO_LAYERED_BETTER = "two-layered arm tracks better"
_TWO_LAYERED_LONGER = "two-layered arm has the longer episodes"
_STATIC_LONGER = "static arm has the longer episodes"
_HIGH = (terms.ang_vel_xy, terms.lin_vel_z, terms.dof_pos_limits, terms.dof_vel_limits)
NEAR_ONE = tuple(term.name for term in _HIGH)
