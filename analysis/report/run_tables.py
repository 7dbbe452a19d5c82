"""Tables of what was run: runs, machine and versions, settings."""

import json
import math
from collections.abc import Iterable

from analysis.data.study import Study, pretty_arm
from analysis.figures.reward_terms import table_1
from analysis.report.cells import MISSING, Table, duration
from tlr_exp import keys
from tlr_exp.config.nested import flat


def runs_table(study: Study) -> Table:
    """What was run."""
    rows = []
    seconds = keys.TIME_PREFIX + "iteration_s"
    for name, run in study.runs.sort_values(["arm", "seed"]).to_dict("index").items():
        curve = study.curves[study.curves["run"] == name]
        hours = curve[seconds].to_numpy().sum() / 3600 if seconds in curve else math.nan
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
