"""The main comparison as a LaTeX table, for a paper."""

import re
from collections.abc import Sequence

from analysis.report.cells import NBSP, Table, interval_text, p_value_text, spread_text
from analysis.report.evidence import Evidence
from analysis.report.outcomes import Outcome
from analysis.statistics.significance import holm

_ESCAPES = {
    "\\": r"\textbackslash{}",
    **{sign: f"\\{sign}" for sign in "&%$#_{}"},
    "~": r"\textasciitilde{}",
    "^": r"\textasciicircum{}",
    "±": r"$\pm$",
    "²": r"\textsuperscript{2}",
    "\N{MINUS SIGN}": "$-$",
    NBSP: "~",
}


def latex_table(
    evidence: Evidence, groups: Sequence[tuple[str, Sequence[Outcome]]], caption: str
) -> str:
    """A table environment (package booktabs) of the outcomes of two arms, in named groups.

    Holm's adjustment is made within a group, as in the tables of the report.
    """
    head = [
        *("", *evidence.labels, "difference [95 % interval]"),
        *("p (Welch, Holm)", "p (permutation, Holm)"),
    ]
    lines = []
    for name, found in groups:
        if found:
            lines += [
                r"    \midrule",
                f"    \\multicolumn{{{len(head)}}}{{l}}{{\\emph{{{tex(name)}}}}} \\\\",
            ]
            lines += [f"    {_row(cells)}" for cells in _cells(found)]
    return _environment(head, lines, caption)


def latex_of(table: Table, caption: str) -> str:
    """A table of the report as a table environment (package booktabs)."""
    rows = [f"    {_row(row)}" for row in table.rows]
    return _environment(table.header, [r"    \midrule", *rows], caption)


def _environment(head: Sequence[str], lines: Sequence[str], caption: str) -> str:
    framed = [
        "% needs \\usepackage{booktabs}",
        r"\begin{table}",
        r"  \centering",
        f"  \\caption{{{tex(caption)}}}",
        f"  \\begin{{tabular}}{{l{'r' * (len(head) - 1)}}}",
        r"    \toprule",
        f"    {_row(head)}",
        *lines,
        *(r"    \bottomrule", r"  \end{tabular}", r"\end{table}"),
    ]
    return "\n".join(framed) + "\n"


def _cells(found: Sequence[Outcome]) -> list[list[str]]:
    welch = holm([each.unpaired.t_test.p_value for each in found])
    exact = holm([each.unpaired.permutation_test.p_value for each in found])
    rows = []
    for outcome, p_welch, p_exact in zip(found, welch, exact, strict=True):
        c, digits = outcome.unpaired, outcome.digits
        unit = f" ({outcome.shown.unit})" if outcome.shown.unit else ""
        arms = (c.baseline, c.treatment)
        means = (spread_text(arm.mean.estimate, arm.std, digits).replace(NBSP, " ") for arm in arms)
        difference = interval_text(c.difference, digits)
        p_values = p_value_text(p_welch), p_value_text(p_exact)
        rows.append([f"{outcome.name}{unit}", *means, difference, *p_values])
    return rows


def _row(cells: Sequence[str]) -> str:
    return " & ".join(map(tex, cells)) + r" \\"


def tex(text: str) -> str:
    """A text for LaTeX: special characters escaped, negative numbers and powers of ten as such."""
    text = re.sub(r"(?<![\w.])-(?=\d)", "\N{MINUS SIGN}", text)
    power = r"(\d(?:\.\d+)?)e(-?)0*(\d+)"
    parts = re.split(power, text)
    out = []
    for place in range(0, len(parts), 4):
        out.append("".join(_ESCAPES.get(sign, sign) for sign in parts[place]))
        if place + 3 < len(parts):
            digits, sign, exponent = parts[place + 1 : place + 4]
            out.append(f"${digits}\\times10^{{{sign}{exponent}}}$")
    return "".join(out)
