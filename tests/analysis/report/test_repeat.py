"""One command for many runs, and the LaTeX table."""

import shlex

import numpy as np
import pytest
from studies import make_study

from analysis.report.content import one_command
from analysis.report.evidence import Evidence
from analysis.report.latex import latex_table, tex
from analysis.report.outcomes import outcomes


def test_every_combination_becomes_one_sweep() -> None:
    commands = [
        f"train.py optimizer={optimizer} seed={seed} 'env.motion=my walk.npz' resume=auto"
        for optimizer in ("fixed", "gwo")
        for seed in (0, 1, 2)
    ]
    one = one_command(commands)
    assert shlex.split(one) == [
        *("tlr-train", "-m", "optimizer=fixed,gwo", "seed=0,1,2"),
        *("env.motion=my walk.npz", "resume=auto"),
    ]


def test_commands_that_are_all_the_same_are_that_one() -> None:
    assert one_command(["tlr-train -m +sweep=five_seeds"] * 3) == "tlr-train -m +sweep=five_seeds"


@pytest.mark.parametrize(
    "commands",
    [
        ["tlr-train seed=0 optimizer=fixed", "tlr-train seed=1 optimizer=gwo"],  # no product
        ["tlr-train seed=0", "tlr-train seed=1 ppo.gamma=0.9"],  # other keys
        ["tlr-train seed=0", "other seed=1"],
        ["tlr-train seed=0 'unclosed", "tlr-train seed=1"],
        ["tlr-train resume", "tlr-train seed=1"],
        [],
    ],
)
def test_what_no_one_command_makes_has_none(commands: list[str]) -> None:
    assert one_command(commands) == ""


def test_characters_of_latex_are_escaped_and_numbers_are_numbers() -> None:
    assert tex("a_b & 5 % {x}") == r"a\_b \& 5 \% \{x\}"
    assert tex("-0.1 ± 0.2, p = 7.7e-07") == r"$-$0.1 $\pm$ 0.2, p = $7.7\times10^{-7}$"
    assert tex("upper-body, gwo-2") == "upper-body, gwo-2"


def test_every_row_of_the_table_has_the_cells_of_its_columns() -> None:
    study = make_study(np.random.default_rng(0), seeds=range(3), iterations=20)
    evidence = Evidence(study)
    text = latex_table(evidence, [("training", outcomes(evidence)), ("none", [])], "50 % & more")
    lines = text.splitlines()
    assert r"\begin{tabular}{lrrrrr}" in text
    rows = [line for line in lines if line.endswith(r"\\") and "multicolumn" not in line]
    assert len(rows) == 1 + len(outcomes(evidence))
    cells = [line.replace(r"\&", "").count("&") + 1 for line in rows]
    assert set(cells) == {6}
    assert r"\caption{50 \% \& more}" in text
    assert sum(line.count("{") - line.count("}") for line in lines) == 0
