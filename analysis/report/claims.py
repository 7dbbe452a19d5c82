"""What the paper claims, as numbers, and what a study can say to each claim.

Numbers and figures are those of Xu, Zheng, Ren (Mathematics 2025, 13(21), 3445). A claim is judged
only by runs of (nearly) the paper's size; what smaller ones show is described, not judged.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from analysis.endpoints import tail_mean
from analysis.report.cells import interval_text, p_text
from analysis.report.evidence import Evidence
from analysis.report.verdicts import Verdict, above_zero, agreement, around
from tlr_exp import keys

PAPER_CONTROL_STEPS = 4096 * 24 * 2500
FULL_SIZE_SHARE = 0.9  # of the paper's control steps per run, from which on a claim is judged
EARLY_SHARE = 0.2  # the first 500 of 2500 iterations, until the two-layered arm overtakes
LONG_EPISODE_STEPS, LONG_EPISODE_SHARE = 200.0, 0.4  # above 200 steps for 1000 of 2500 iterations


@dataclass(frozen=True)
class Finding:
    """Our number beside a claim, and what it says of the claim."""

    ours: str
    verdict: Verdict
    reason: str


@dataclass(frozen=True)
class Claim:
    """One statement of the paper.

    Attributes:
        statement: what is claimed, in a sentence.
        paper: the paper's number.
        source: where it stands.
        judge: what the evidence would say, were the runs of the paper's size.
    """

    statement: str
    paper: str
    source: str
    judge: Callable[[Evidence], Finding]


def findings(evidence: Evidence) -> list[tuple[Claim, Finding]]:
    """Every claim with what the study says of it."""
    return [(claim, _judged(claim, evidence)) for claim in CLAIMS]


def _judged(claim: Claim, evidence: Evidence) -> Finding:
    finding = claim.judge(evidence)
    share = evidence.control_steps_per_run / PAPER_CONTROL_STEPS
    if share >= FULL_SIZE_SHARE:
        return finding
    return Finding(finding.ours, Verdict.CANNOT_SAY, f"At this scale: {finding.reason}")


# --- the judges ------------------------------------------------------------------------------
def _improvement(metric: str, paper_percent: float) -> Callable[[Evidence], Finding]:
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


def _single_run(metric: str, paper_percent: float) -> Callable[[Evidence], Finding]:
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


def _longer_static_at_first(evidence: Evidence) -> Finding:
    at, *both = evidence.common(keys.EPISODE_LENGTH)
    early = at <= max(at[0], EARLY_SHARE * at[-1])
    static, two_layered = (values[:, early].mean(axis=1) for values in both)
    interval = evidence.difference(two_layered, static)
    ours = f"static longer by {interval_text(interval, 1)} steps in the first 20 % of training"
    return Finding(ours, *above_zero(interval, _STATIC_LONGER, _TWO_LAYERED_LONGER))


def _overtakes(evidence: Evidence) -> Finding:
    at, *both = evidence.common(keys.EPISODE_LENGTH)
    static, two_layered = (tail_mean(values, at) for values in both)
    interval = evidence.difference(static, two_layered)
    ours = f"two-layered longer by {interval_text(interval, 1)} steps in the last 20 %"
    return Finding(ours, *above_zero(interval, _TWO_LAYERED_LONGER, _STATIC_LONGER))


def _long_episodes(evidence: Evidence) -> Finding:
    _, two_layered = evidence.curves(keys.EPISODE_LENGTH)
    share = float((two_layered.mean(axis=0) > LONG_EPISODE_STEPS).mean())
    enough = share >= LONG_EPISODE_SHARE
    verdict = Verdict.REPRODUCED if enough else Verdict.NOT_REPRODUCED
    ours = f"above {LONG_EPISODE_STEPS:.0f} steps in {100 * share:.0f} % of the iterations"
    return Finding(ours, verdict, f"{'at least' if enough else 'less than'} the paper's 40 %")


def _final_weights(names: tuple[str, ...], paper: float) -> Callable[[Evidence], Finding]:
    """The last weights of some terms against the paper's: each of them, at 95 % together."""

    def judge(evidence: Evidence) -> Finding:
        known = [name for name in names if keys.WEIGHT_PREFIX + name in evidence.metric_names]
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


def _mean_weight(name: str, paper: float) -> Callable[[Evidence], Finding]:
    def judge(evidence: Evidence) -> Finding:
        metric = keys.WEIGHT_PREFIX + name
        if metric not in evidence.metric_names:
            return Finding("not in this reward", Verdict.CANNOT_SAY, f"{name} is not in use")
        means = evidence.treatment_curve(metric).mean(axis=1)
        return Finding(f"{means.mean():.3f}", *around(means, paper))

    return judge


def _overhead(paper_share: float) -> Callable[[Evidence], Finding]:
    def judge(evidence: Evidence) -> Finding:
        search = evidence.treatment_curve(_seconds("weights"))
        # As in Figure 15, without the evaluations, which the paper's iterations do not have.
        training = evidence.treatment_sum(_seconds("iteration"))
        training -= evidence.treatment_sum(_seconds("evaluate"))
        share = evidence.treatment_sum(_seconds("weights")) / training
        ours = (
            f"{search.mean():.3g} ± {search.std():.2g} s, {100 * share:.2g} % of an iteration "
            "without its evaluation"
        )
        verdict = Verdict.REPRODUCED if share <= paper_share else Verdict.NOT_REPRODUCED
        return Finding(
            ours, verdict, f"the paper's share is {100 * paper_share:.1f} %, on its machine"
        )

    return judge


def _seconds(phase: str) -> str:
    return f"{keys.TIME_PREFIX}{phase}_s"


_TWO_LAYERED_LONGER = "two-layered arm has the longer episodes"
_STATIC_LONGER = "static arm has the longer episodes"
_NEAR_ONE = (keys.ANG_VEL_XY, keys.LIN_VEL_Z, keys.DOF_POS_LIMITS, keys.DOF_VEL_LIMITS)

CLAIMS = (
    Claim(
        "Upper-body tracking error falls against the static reward, averaged over training.",
        "4.25 % better, p = 1.72e-9",
        "five seeds, Fig. 13",
        _improvement(keys.TRAIN_UPPER_BODY_ERROR, 4.25),
    ),
    Claim(
        "Lower-body tracking error falls against the static reward, averaged over training.",
        "4.98 % better, p = 6.00e-13",
        "five seeds, Fig. 13",
        _improvement(keys.TRAIN_LOWER_BODY_ERROR, 4.98),
    ),
    Claim(
        "Upper-body error of a single run.",
        "7.58 % better",
        "one run, Figs. 7 and 8",
        _single_run(keys.TRAIN_UPPER_BODY_ERROR, 7.58),
    ),
    Claim(
        "Lower-body error of a single run.",
        "10.30 % better",
        "one run, Figs. 7 and 8",
        _single_run(keys.TRAIN_LOWER_BODY_ERROR, 10.30),
    ),
    Claim(
        "At first the static arm has the longer episodes.",
        "up to about iteration 500 of 2500",
        "one run, Fig. 6",
        _longer_static_at_first,
    ),
    Claim(
        "In the end the two-layered arm has the longer episodes.",
        "after about iteration 500 of 2500",
        "one run, Fig. 6",
        _overtakes,
    ),
    Claim(
        "The two-layered arm's episodes stay above 200 control steps.",
        "over 1000 of 2500 iterations",
        "one run, Fig. 6",
        _long_episodes,
    ),
    Claim(
        "Four of the six weights end high.",
        "near 0.9",
        "one run, Fig. 14",
        _final_weights(_NEAR_ONE, 0.9),
    ),
    Claim(
        "The weight of dof_pos_limits ends high.",
        "0.92",
        "one run, Fig. 14",
        _final_weights((keys.DOF_POS_LIMITS,), 0.92),
    ),
    Claim(
        "The weight of dof_pos_limits, averaged over training.",
        "0.676",
        "one run, Fig. 14",
        _mean_weight(keys.DOF_POS_LIMITS, 0.676),
    ),
    Claim(
        "The weight search costs little of an iteration.",
        "3.72 ± 0.06 s, 8.7 %",
        "Fig. 15",
        _overhead(0.087),
    ),
)
