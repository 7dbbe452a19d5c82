"""Table 1 of the paper, as data: the terms of the lower layer as the runs were configured."""

import json
from dataclasses import dataclass

from analysis.data.study import Study, StudyError, pretty_arm
from tlr_exp.env.terms import PAPER_LOWER_LAYER, TERMS

_SYMBOLS = {"margin": "ε", "sigma": "\N{GREEK SMALL LETTER SIGMA}"}


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
