"""Tables of what was run: runs, machines, the lower layer, settings, the values of a sweep."""

import json
import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from analysis.data.settings import flat
from analysis.data.study import Study, StudyError, pretty_arm
from analysis.measures.quantities import ITERATION_S, TRAINING, quantity
from analysis.measures.swept import Sweep, end_of_training
from analysis.report.cells import MISSING, Table, duration, number, p_text, spread_text
from analysis.report.evidence import SEED, Evidence
from analysis.report.outcomes import digits_of
from analysis.statistics.trend import trend
from tlr_exp.env.terms import PAPER_LOWER_LAYER, TERMS

_SYMBOLS = {"margin": "ε", "sigma": "\N{GREEK SMALL LETTER SIGMA}"}


def runs_table(study: Study) -> Table:
    """What was run."""
    rows = []
    for name, run in study.runs.sort_values(["arm", "seed"]).to_dict("index").items():
        curve = study.curves[study.curves["run"] == name]
        hours = curve[ITERATION_S].to_numpy().sum() / 3600 if ITERATION_S in curve else math.nan
        rows.append(
            (
                *(str(name), pretty_arm(run["arm"]), str(run["seed"]), run["status"]),
                *(str(len(curve)), f"{run['control_steps'] / 1e6:.2f} million"),
                *(duration(hours), _short(run["commit"])),
            )
        )
    header = (
        *("run", "arm", "seed", "status", "iterations", "control steps"),
        *("time in iterations", "commit"),
    )
    return Table("Runs", header, tuple(rows))


def environment_table(study: Study) -> Table:
    """Where it was run: machines and versions, each distinct value."""
    runs = study.runs
    packages = [json.loads(text) for text in runs["packages"].unique() if text]
    versions = {
        name: ", ".join(sorted({str(found.get(name, MISSING)) for found in packages}))
        for name in sorted({name for found in packages for name in found})
    }
    rows = [
        ("device", _distinct(runs["device"])),
        ("processor", _distinct(runs["cpu_model"])),
        *versions.items(),
    ]
    return Table("Environment", ("what", "value"), tuple(rows))


def settings_table(study: Study) -> Table:
    """The resolved configuration that the runs share, and what differs between the arms."""
    configs = [flat(json.loads(text)) for text in study.runs["config"]]
    names = sorted({name for config in configs for name in config})
    rows = tuple(
        (name, ", ".join(dict.fromkeys(str(c[name]) for c in configs if name in c)))
        for name in names
    )
    return Table("Settings", ("key", "value"), rows)


def _short(commit: str) -> str:
    revision, dash, dirty = commit.partition("-")
    return revision[:10] + dash + dirty or MISSING


def _distinct(column: Iterable[object]) -> str:
    return ", ".join(sorted({str(value) for value in column if value})) or MISSING


# --- the lower layer --------------------------------------------------------------------------
@dataclass(frozen=True)
class TermRow:
    """One term of the lower layer.

    name: as in the configuration. formula and unit: of the raw value. coefficient: per second, it
    multiplies weight and raw value. constants: "ε = 0.1", empty where it has none. arms: whose
    configuration has it so, empty where all have. in_paper: whether Table 1 or Figure 14 has it.
    """

    name: str
    formula: str
    unit: str
    coefficient: float
    constants: str
    arms: tuple[str, ...]
    in_paper: bool


def table_1(study: Study) -> tuple[TermRow, ...]:
    """The terms of the lower layer from the configurations of the runs, in their order.

    A term that arms configure differently has a row per configuration.

    Raises:
        StudyError: the configurations have no lower layer.
    """
    found: dict[tuple[str, float, str], list[str]] = {}
    for arm in study.arms:
        for config in study.runs.loc[study.runs["arm"] == arm, "config"].unique():
            for term in _terms(json.loads(config)):
                arms = found.setdefault(term, [])
                if arm not in arms:
                    arms.append(arm)
    if not found:
        raise StudyError("no run's configuration has terms under reward.optimizing")
    return tuple(
        TermRow(
            name,
            *_formula_and_unit(name),
            coefficient,
            constants,
            () if len(arms) == len(study.arms) else tuple(pretty_arm(arm) for arm in arms),
            name in PAPER_LOWER_LAYER,
        )
        for (name, coefficient, constants), arms in found.items()
    )


def _formula_and_unit(name: str) -> tuple[str, str]:
    """Empty for a term of another version, which this one does not have."""
    term = TERMS.get(name)
    return ("", "") if term is None else (term.formula, term.unit)


def _terms(config: dict) -> list[tuple[str, float, str]]:
    """Name, coefficient and constants of every term of the lower layer of one configuration."""
    reward = config.get("reward", {})
    parameters = reward.get("parameters") or {}
    scale = float(reward.get("penalty_scale", 1.0))  # runs from before it was a key
    return [
        (name, scale * float(coefficient), _constants(parameters.get(name) or {}))
        for name, coefficient in (reward.get("optimizing") or {}).items()
    ]


def _constants(values: dict[str, float]) -> str:
    return ", ".join(f"{_SYMBOLS.get(name, name)} = {value:g}" for name, value in values.items())


def terms_table(study: Study) -> Table:
    """The lower layer as it was configured: the paper's Table 1."""
    rows = tuple(
        (
            *(term.name, term.formula, term.unit, f"{term.coefficient:g}", term.constants),
            *("yes" if term.in_paper else "no", ", ".join(term.arms) or "all"),
        )
        for term in table_1(study)
    )
    header = ("term", "raw value", "unit", "coefficient (1/s)", "constants", "in the paper", "arms")
    note = "A term enters the reward as weight * coefficient * control step * raw value."
    return Table("The lower layer (the paper's Table 1)", header, rows, note)


# --- a sweep over a number --------------------------------------------------------------------
def metrics_of(study: Study) -> tuple[str, ...]:
    """The metrics of training that the runs of every arm have."""
    pairs = [Evidence(study, arm) for arm in study.arms[1:]]
    return tuple(metric for metric in TRAINING if all(pair.has(metric) for pair in pairs))


def values_table(study: Study, sweep: Sweep) -> Table:
    """Mean and spread over seeds of every metric, a row per value, then the other arms."""
    rows = [
        _values_row(study, f"{pretty_arm(method)}, {value:g}", arm)
        for method, line in sweep.lines.items()
        for value, arm in line.items()
    ]
    rows += [
        _values_row(study, pretty_arm(method), arm) for method, arm in sweep.references.items()
    ]
    names = (f"{quantity(metric).label}" for metric in metrics_of(study))
    note = "Mean ± standard deviation over seeds of the mean over the last 20 % of training."
    return Table(f"Results by {sweep.key}", ("arm", "seeds", *names), tuple(rows), note)


def _values_row(study: Study, name: str, arm: str) -> tuple[str, ...]:
    cells = []
    for metric in metrics_of(study):
        sample = end_of_training(study, metric, arm)
        spread = float(sample.std(ddof=1)) if sample.size > 1 else math.nan
        cells.append(spread_text(float(sample.mean()), spread, digits_of(metric)))
    return (name, str(len(study.seeds(arm))), *cells)


def trend_table(study: Study, sweep: Sweep) -> Table:
    """Does the value matter, and does more of it mean more of the metric: a row per metric."""
    header = (
        *("metric", "method", "p, the value matters"),
        *("rank correlation with the value", "p, it grows or falls with it"),
    )
    note = (
        "Permutations of the runs: Kruskal and Wallis' H (any difference between the values) and "
        "Spearman's rank correlation (one direction), not adjusted for the number of rows. Runs "
        "of the same seed count as independent."
    )
    return Table("All values together", header, tuple(_trend_rows(study, sweep)), note)


def _trend_rows(study: Study, sweep: Sweep) -> Iterator[tuple[str, ...]]:
    for metric in metrics_of(study):
        for method, line in sweep.lines.items():
            samples = [end_of_training(study, metric, arm) for arm in line.values()]
            found = trend(list(line), samples, generator=np.random.default_rng(SEED))
            yield (
                quantity(metric).name,
                pretty_arm(method),
                p_text(found.any_difference),
                number(found.monotone.statistic, 2),
                p_text(found.monotone),
            )
