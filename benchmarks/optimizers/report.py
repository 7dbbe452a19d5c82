"""The table and the figure of docs/optimizers.md, from the summaries of a benchmark."""

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from benchmarks.optimizers.measure import Summary

BEGIN, END = "<!-- benchmark: begin -->", "<!-- benchmark: end -->"
FLOOR = 1e-12  # errors below it are rounding; the logarithm needs a smallest
HIGHLIGHT, OTHER, CONTROL = "#1f5fa8", "#6b6b6b", "#c4612a"


def insert(page: str, text: str) -> str:
    """The page with `text` between its two marks.

    Raises:
        ValueError: a mark is missing.
    """
    before, begin, rest = page.partition(BEGIN)
    _, end, after = rest.partition(END)
    if not (begin and end):
        raise ValueError(f"the page has no marks {BEGIN} and {END} to put the table between")
    return f"{before}{BEGIN}\n\n{text.strip()}\n\n{END}{after}"


def tables(summaries: Sequence[Summary]) -> str:
    """One table for each group: median errors, the best of a column bold, and the time."""
    return "\n\n".join(
        f"**{group}**\n\n{_table(_of_group(summaries, group))}" for group in groups(summaries)
    )


def groups(summaries: Sequence[Summary]) -> list[str]:
    return list(dict.fromkeys(summary.group for summary in summaries))


def _of_group(summaries: Sequence[Summary], group: str) -> list[Summary]:
    return [summary for summary in summaries if summary.group == group]


def _table(summaries: Sequence[Summary]) -> str:
    problems = list(dict.fromkeys(summary.problem for summary in summaries))
    searches = list(dict.fromkeys(summary.search for summary in summaries))
    cell = {(s.problem, s.search): s for s in summaries}
    best = {p: min(cell[p, s].median for s in searches) for p in problems}
    lines = [
        f"| | {' | '.join(problems)} | time, ms |",
        f"|---|{'---:|' * (len(problems) + 1)}",
    ]
    for search in searches:
        errors = [
            _bold(_number(cell[p, search].median), cell[p, search].median == best[p])
            for p in problems
        ]
        milliseconds = 1e3 * np.median([cell[p, search].seconds for p in problems])
        lines.append(f"| {search} | {' | '.join(errors)} | {milliseconds:.0f} |")
    return "\n".join(lines)


def _number(value: float) -> str:
    """Two digits; with an exponent only where that is shorter."""
    rounded = float(f"{value:.2g}")
    return f"{rounded:g}" if 1e-4 <= abs(rounded) < 1e5 else f"{value:.2g}"


def _bold(text: str, condition: bool) -> str:
    return f"**{text}**" if condition else text


def draw(summaries: Sequence[Summary], path: Path) -> None:
    """A panel for each test function and dimension: median and quartiles of the error."""
    shown = [s for s in summaries if not s.group.startswith("J")]
    rows, columns = groups(shown), list(dict.fromkeys(s.problem for s in shown))
    figure = Figure(figsize=(11.0, 2.6 * len(rows)), layout="constrained")
    axes = figure.subplots(len(rows), len(columns), squeeze=False, sharey=True)
    for row, group in enumerate(rows):
        for column, problem in enumerate(columns):
            of_panel = [s for s in shown if (s.group, s.problem) == (group, problem)]
            _panel(axes[row, column], of_panel)
            if row == 0:
                axes[row, column].set_title(problem, fontsize=10)
            if row == len(rows) - 1:
                axes[row, column].set_xlabel("error at 1530 evaluations")
        axes[row, 0].set_ylabel(group)
    figure.savefig(path, dpi=120)


def _panel(axes: Axes, summaries: Sequence[Summary]) -> None:
    for place, summary in enumerate(reversed(summaries)):
        low, middle, high = (
            max(value, FLOOR)
            for value in (summary.lower_quartile, summary.median, summary.upper_quartile)
        )
        color = {"gwo": HIGHLIGHT, "random_search": CONTROL}.get(summary.search, OTHER)
        axes.plot([low, high], [place, place], color=color, linewidth=3, alpha=0.35)
        axes.plot([middle], [place], "o", color=color, markersize=5)
    axes.set_xscale("log")
    low, high = axes.get_xlim()
    narrow = high < 30.0 * low
    axes.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if narrow else (1.0,), numticks=6))
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: _number(value)))
    axes.xaxis.set_minor_formatter(NullFormatter())
    axes.set_yticks(range(len(summaries)), [s.search for s in reversed(summaries)])
    axes.tick_params(labelsize=8)
    axes.grid(axis="x", color="#dddddd", linewidth=0.6)
    axes.set_axisbelow(True)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)


def mean_ranks(summaries: Sequence[Summary]) -> dict[str, float]:
    """Mean place of each search among all, over the test functions (1: the smallest median)."""
    places: dict[str, list[float]] = {}
    shown = [s for s in summaries if not s.group.startswith("J")]
    for group in groups(shown):
        for problem in dict.fromkeys(s.problem for s in shown):
            cells = [s for s in shown if (s.group, s.problem) == (group, problem)]
            for cell in cells:
                better = sum(other.median < cell.median for other in cells)
                places.setdefault(cell.search, []).append(1.0 + better)
    return {name: math.fsum(found) / len(found) for name, found in places.items()}
