"""Compare the weight optimizers: error at the budget of the paper's search, and time per search.

    python -m benchmarks.optimizers

writes `benchmarks/results/optimizers.json`, and the tables and the figure of `docs/optimizers.md`.
"""

import argparse
import json
import platform
from importlib import metadata
from pathlib import Path

import torch

from benchmarks.optimizers import report
from benchmarks.optimizers.measure import Summary, as_records, measure, summarise
from benchmarks.optimizers.searches import BUDGET, all_searches

ROOT = Path(__file__).parents[2]
RESULTS = ROOT / "benchmarks" / "results" / "optimizers.json"
PAGE = ROOT / "docs" / "optimizers.md"
FIGURE = ROOT / "docs" / "images" / "optimizers.png"
PACKAGES = ("torch", "numpy", "scipy", "cmaes", "mealpy")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=20, help="searches of each kind")
    parser.add_argument("--draw", action="store_true", help="only draw from the saved results")
    arguments = parser.parse_args()
    torch.set_num_threads(1)
    if not arguments.draw:
        summaries = summarise(measure(all_searches(), range(arguments.seeds)))
        versions = {name: metadata.version(name) for name in PACKAGES}
        content = {
            "budget": BUDGET,
            "seeds": arguments.seeds,
            "machine": platform.machine(),
            "versions": versions,
            "summaries": as_records(summaries),
        }
        RESULTS.write_text(json.dumps(content, indent=1) + "\n")
    saved = json.loads(RESULTS.read_text())
    summaries = [Summary(**record) for record in saved["summaries"]]
    report.draw(summaries, FIGURE)
    ranks = report.mean_ranks(summaries)
    order = ", ".join(f"{name} {rank:.1f}" for name, rank in sorted(ranks.items(), key=_second))
    text = f"{report.tables(summaries)}\n\nMean place over the twelve test functions: {order}."
    PAGE.write_text(report.insert(PAGE.read_text(), text))
    print(f"{RESULTS}\n{FIGURE}\n{PAGE}")


def _second(item: tuple[str, float]) -> float:
    return item[1]


if __name__ == "__main__":
    main()
