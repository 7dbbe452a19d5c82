"""Measures how runs move without exploration noise: one number per run and measure.

From the roll-outs of many start phases where the study has them (``Study.starts``), else from the
last evaluation during training that all runs have. Measures carry the names of the columns of
starts.csv, and terms of the lower layer are raw means under ``reward_term/NAME``.
"""

import json
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
import pandas as pd

from analysis.data.starts import PHASE, measures_in
from analysis.data.study import RUN, Study
from analysis.measures.quantities import COST, SUCCESS
from tlr_exp.keys import EVAL_PREFIX, ITERATION, REWARD_TERM_PREFIX


@dataclass(frozen=True, eq=False)
class Rollouts:
    """Measures without noise.

    by_run: index run, a float column per measure: means over a run's roll-outs, NaN where it has
        none. `success` is the share of roll-outs with a survival of 1, `lower_layer_cost` what the
        baseline's lower layer at weights 1 takes from the reward in a second.
    source: in words, "16 roll-outs a run, without noise".
    lacking: why there is no lower-layer cost; empty where there is.
    """

    by_run: pd.DataFrame = field(repr=False)
    source: str
    lacking: str = ""

    def of_arm(self, study: Study, measure: str, arm: str) -> pd.Series:
        """One number per seed of an arm (index seed, ascending), without runs that lack it."""
        if measure not in self.by_run.columns:
            return pd.Series(dtype=np.float64)
        runs = pd.DataFrame(study.runs[study.runs["arm"] == arm]).sort_values("seed")
        values = self.by_run[measure].reindex(runs.index)
        return pd.Series(values.to_numpy(), index=runs["seed"].to_numpy()).dropna()

    def has(self, study: Study, measure: str, *arms: str) -> bool:
        """Whether every run of these arms has the measure."""
        counts = [len(self.of_arm(study, measure, arm)) for arm in arms]
        return counts == [len(study.seeds(arm)) for arm in arms]


def rollouts(study: Study, with_terms: bool = False) -> Rollouts | None:
    """The measures without noise; None where the study has none.

    with_terms: take roll-outs from start phases only where they have the terms of the lower layer;
        tables of earlier versions lack them, and the evaluations during training have them.
    """
    terms = lower_layer(study)
    starts = study.starts
    columns = [REWARD_TERM_PREFIX + name for name in terms]
    # A table that lacks runs compares no arms.
    complete = len(starts) > 0 and set(study.runs.index) <= set(starts[RUN])
    if complete and (not with_terms or set(columns) <= set(starts.columns)):
        frame = pd.DataFrame(starts.groupby(RUN, sort=False)[measures_in(starts)].mean())
        if "survival" in starts.columns:
            frame[SUCCESS] = starts["survival"].eq(1.0).groupby(starts[RUN]).mean()
        counts = sorted(set(starts.groupby(RUN).size()))
        source = f"{' or '.join(map(str, counts))} roll-outs a run"
    else:
        frame, iteration = _last_evaluation(study)
        if frame.empty:
            return None
        source = f"the evaluation during training at iteration {iteration}"
    cost, lacking = _cost(frame, terms)
    return Rollouts(frame.assign(**{COST: cost}), f"{source}, without noise", lacking)


def _last_evaluation(study: Study) -> tuple[pd.DataFrame, int]:
    """The evaluation metrics of every run at the last iteration that all were evaluated in."""
    names = [name for name in study.metric_names if name.startswith(EVAL_PREFIX)]
    rows = pd.DataFrame(study.curves[[RUN, ITERATION, *names]])
    rows = pd.DataFrame(rows[rows[names].notna().to_numpy().any(axis=1)])
    iterations, counts = np.unique(rows[ITERATION].to_numpy(), return_counts=True)
    common = iterations[counts == len(study.runs)]
    if common.size == 0:
        return pd.DataFrame(), 0
    last = int(common.max())
    frame = pd.DataFrame(rows[rows[ITERATION] == last]).set_index(RUN)[names]
    frame.columns = [name.removeprefix(EVAL_PREFIX) for name in names]
    return pd.DataFrame(frame), last


def lower_layer(study: Study) -> dict[str, float]:
    """What a unit of each term's raw value costs at weight 1, per second, in the baseline.

    The baseline's for all arms, so that arms which train with other penalties, or with none, are
    held against one measure.
    """
    config = json.loads(study.runs.loc[study.runs["arm"] == study.baseline, "config"].iloc[0])
    reward = config.get("reward") or {}
    scale = float(reward.get("penalty_scale", 1.0))  # runs from before it was a key
    terms = reward.get("optimizing") or {}
    return {name: -scale * float(coefficient) for name, coefficient in terms.items()}


def _cost(frame: pd.DataFrame, terms: Mapping[str, float]) -> tuple[pd.Series, str]:
    """Cost a second of every run [runs], and why there is none where there is none."""
    nothing = pd.Series(np.nan, index=frame.index)
    if not terms:
        return nothing, "the baseline has no lower layer"
    lacking = [name for name in terms if REWARD_TERM_PREFIX + name not in frame.columns]
    if lacking:
        return nothing, f"{', '.join(lacking)} was not measured without noise"
    parts = [weight * frame[REWARD_TERM_PREFIX + name] for name, weight in terms.items()]
    return pd.Series(sum(parts), index=frame.index), ""


@dataclass(frozen=True)
class SamePhase:
    """A measure of two arms from the same seed and the same start phase, by seed.

    seeds [n]; baseline and treatment [n]: means over the phases from which both stay upright;
    pairs: how many such roll-outs, of how many that both have.
    """

    seeds: tuple[int, ...]
    baseline: np.ndarray
    treatment: np.ndarray
    pairs: int
    out_of: int


def same_phase(study: Study, measure: str, treatment: str) -> SamePhase | None:
    """The baseline and another arm where both stay upright to the end, pair by pair.

    Means over those roll-outs in which each arm alone stays upright would compare different phases,
    hard ones in the arm that falls less. None where the starts, the measure or a pair is missing.
    """
    if len(study.starts) == 0 or not {measure, "upright"} <= set(study.starts.columns):
        return None
    runs = study.runs.loc[study.starts[RUN], ["arm", "seed"]].reset_index(drop=True)
    columns = study.starts[[PHASE, "upright", measure]].reset_index(drop=True)
    rows = pd.concat([columns, runs], axis=1)
    arms = [pd.DataFrame(rows[rows["arm"] == arm]) for arm in (study.baseline, treatment)]
    both = arms[0].merge(arms[1], on=["seed", PHASE], suffixes=("_b", "_t"))
    kept = pd.DataFrame(both[(both["upright_b"] == 1.0) & (both["upright_t"] == 1.0)])
    kept = kept.dropna(subset=[f"{measure}_b", f"{measure}_t"])
    if kept.empty:
        return None
    means = pd.DataFrame(kept.groupby("seed")[[f"{measure}_b", f"{measure}_t"]].mean())
    return SamePhase(
        tuple(int(seed) for seed in means.index),
        means[f"{measure}_b"].to_numpy(),
        means[f"{measure}_t"].to_numpy(),
        len(kept),
        len(both),
    )
