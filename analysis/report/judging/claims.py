"""The claims of the paper, as numbers, and what a study can say to each.

Numbers and figures are those of Xu, Zheng, Ren (Mathematics 2025, 13(21), 3445). A claim is judged
by runs of any size whose policies track; `verdicts` says where they have not come far enough.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from analysis.report.cells import Table
from analysis.report.evidence import Evidence
from analysis.report.judging import judges
from analysis.report.judging.judges import Finding
from analysis.report.judging.verdicts import TRACKS, Verdict, taken_back, too_early
from tlr_exp import keys
from tlr_exp.env.terms import dof_pos_limits


@dataclass(frozen=True)
class Claim:
    """One statement of the paper.

    Attributes:
        statement: what is claimed, in a sentence.
        paper: the paper's number.
        source: where it stands.
        judge: what the evidence says, if the runs have come far enough.
        of_tracking: whether it is about policies that track; those that do not, say nothing then.
        compared: the metric in which two arms differ at the end, which more training may turn.
    """

    statement: str
    paper: str
    source: str
    judge: Callable[[Evidence], Finding]
    of_tracking: bool = True
    compared: str = ""


Judged = Sequence[tuple[Claim, Finding]]


def findings(evidence: Evidence) -> list[tuple[Claim, Finding]]:
    """Every claim with what the study says of it."""
    return [(claim, _judged(claim, evidence)) for claim in CLAIMS]


def _judged(claim: Claim, evidence: Evidence) -> Finding:
    finding = claim.judge(evidence)
    if finding.verdict is Verdict.CANNOT_SAY:
        return finding
    reason = too_early(evidence) if claim.of_tracking else ""
    if not reason and claim.compared:
        reason = taken_back(evidence, claim.compared)
    if not reason:
        return finding
    return Finding(finding.ours, Verdict.CANNOT_SAY, f"{finding.reason}; but {reason}")


def claims_table(judged: Judged) -> Table:
    """The paper's number beside ours, and a verdict, for every claim."""
    rows = tuple(
        (c.statement, f"{c.paper} ({c.source})", f.ours, f.verdict.value, f.reason)
        for c, f in judged
    )
    return Table(
        "The paper's claims",
        ("claim", "paper", "ours", "verdict", "why"),
        rows,
        "Brackets hold 95 % intervals with the seed as the unit. Each claim is judged by itself: "
        "nothing is adjusted for their number. Claims about policies that track are judged where "
        f"in one arm at least {100 * TRACKS:.0f} % of the roll-outs succeed (else: the motion is "
        "survived; without either: no error still falls by more than 5 % in the last fifth); a "
        "difference that another training as long would take away, by the slopes of "
        "the last fifth, is no verdict.",
    )


CLAIMS = (
    Claim(
        "Upper-body tracking error falls against the static reward, averaged over training.",
        "4.25 % better, p = 1.72e-9",
        "five seeds, Fig. 13",
        judges.improvement(keys.TRAIN_UPPER_BODY_ERROR, 4.25),
        compared=keys.TRAIN_UPPER_BODY_ERROR,
    ),
    Claim(
        "Lower-body tracking error falls against the static reward, averaged over training.",
        "4.98 % better, p = 6.00e-13",
        "five seeds, Fig. 13",
        judges.improvement(keys.TRAIN_LOWER_BODY_ERROR, 4.98),
        compared=keys.TRAIN_LOWER_BODY_ERROR,
    ),
    Claim(
        "Upper-body error of a single run.",
        "7.58 % better",
        "one run, Figs. 7 and 8",
        judges.single_run(keys.TRAIN_UPPER_BODY_ERROR, 7.58),
        compared=keys.TRAIN_UPPER_BODY_ERROR,
    ),
    Claim(
        "Lower-body error of a single run.",
        "10.30 % better",
        "one run, Figs. 7 and 8",
        judges.single_run(keys.TRAIN_LOWER_BODY_ERROR, 10.30),
        compared=keys.TRAIN_LOWER_BODY_ERROR,
    ),
    Claim(
        "At first the static arm has the smaller upper-body error.",
        "up to about iteration 500 of 2500, which are 49 million control steps",
        "one run, Fig. 7",
        judges.tracks_better_at_first(keys.TRAIN_UPPER_BODY_ERROR),
        of_tracking=False,
    ),
    Claim(
        "At first the static arm has the smaller lower-body error.",
        "up to about iteration 500 of 2500, which are 49 million control steps",
        "one run, Fig. 7",
        judges.tracks_better_at_first(keys.TRAIN_LOWER_BODY_ERROR),
        of_tracking=False,
    ),
    Claim(
        "At first the static arm has the longer episodes.",
        "up to about iteration 500 of 2500",
        "one run, Fig. 6",
        judges.longer_static_at_first,
        of_tracking=False,
    ),
    Claim(
        "In the end the two-layered arm has the longer episodes.",
        "after about iteration 500 of 2500",
        "one run, Fig. 6",
        judges.overtakes,
        compared=keys.EPISODE_LENGTH,
    ),
    Claim(
        "The two-layered arm's episodes stay above 200 control steps.",
        "over 1000 of 2500 iterations",
        "one run, Fig. 6",
        judges.long_episodes,
    ),
    Claim(
        "Four of the six weights end high.",
        "near 0.9",
        "one run, Fig. 14",
        judges.final_weights(judges.NEAR_ONE, 0.9),
    ),
    Claim(
        "The weight of dof_pos_limits ends high.",
        "0.92",
        "one run, Fig. 14",
        judges.final_weights((dof_pos_limits.name,), 0.92),
    ),
    Claim(
        "The weight of dof_pos_limits, averaged over training.",
        "0.676",
        "one run, Fig. 14",
        judges.mean_weight(dof_pos_limits.name, 0.676),
    ),
    Claim(
        "The weight search costs little of an iteration.",
        "3.72 ± 0.06 s, 8.7 %",
        "Fig. 15",
        judges.overhead(0.087),
        of_tracking=False,
    ),
    Claim(
        "The two-layered policy lags less behind its reference.",
        "reduced latency, without a measure",
        "snapshots, Figs. 9 to 12",
        judges.less_latency,
    ),
)
