"""Control steps a second of a whole training, against another checkout of this project.

    git worktree add ../before be42500
    python benchmarks/training_speed.py --against ../before --threads 1

Both train in turns, in processes of their own, so that a machine that changes its pace changes it
for both. Arguments after ``--`` are overrides for this checkout alone: against one from before
there were recipes, ``-- recipe=paper`` compares the speed of the same learning; without it the
recipes differ, too.
"""

import argparse
import json
import os
import statistics
import subprocess
import sys
import tempfile
import tomllib
from pathlib import Path

HERE = Path(__file__).resolve().parents[1]
PHASES = ("collect", "weights", "advantage", "update", "landscape", "iteration")
# tlr-train of a checkout by its own conf/, which lies beside the package: left alone, Python takes
# that of the installed checkout.
LAUNCH = """
import sys
from importlib import import_module
import tlr_exp
tlr_exp.__path__.append(sys.argv.pop(1))
module, function = sys.argv.pop(1).split(":")
getattr(import_module(module), function)()
"""


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--against", type=Path, required=True, help="the other checkout")
    parser.add_argument("--threads", type=int, default=1, help="of PyTorch and of the engine")
    parser.add_argument(
        "--iterations", type=int, default=8, help="of each run; the first is left out"
    )
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("overrides", nargs="*", help="for this checkout alone")
    arguments = parser.parse_args()
    common = [
        *("scale=laptop", f"scale.iterations={arguments.iterations}", "tracking_uri=none"),
        *("scale.evaluate_every=1000", "scale.checkpoint_every=1000", "resume=never"),
        *(f"num_threads={arguments.threads}", f"physics.num_threads={arguments.threads}"),
    ]
    seconds: dict[str, list[dict[str, float]]] = {"before": [], "here": []}
    for _ in range(arguments.rounds):
        seconds["before"] += train(arguments.against.resolve(), common)
        seconds["here"] += train(HERE, [*common, *arguments.overrides])
    print(f"{'':12}{'before, s':>12}{'here, s':>12}{'ratio':>8}   (of minima; of medians)")
    for phase in PHASES:
        before, here = ([row[phase] for row in seconds[side]] for side in ("before", "here"))
        ratios = min(before) / min(here), statistics.median(before) / statistics.median(here)
        print(f"{phase:12}{min(before):12.3f}{min(here):12.3f}{ratios[0]:8.2f}{ratios[1]:8.2f}")


def train(checkout: Path, overrides: list[str]) -> list[dict[str, float]]:
    """Seconds of every phase of every iteration but the first (and the last, which evaluates)."""
    environment = {**os.environ, "PYTHONPATH": str(checkout)}
    with tempfile.TemporaryDirectory() as folder:
        project = tomllib.loads((checkout / "pyproject.toml").read_text(encoding="utf-8"))
        launch = [LAUNCH, str(checkout), project["project"]["scripts"]["tlr-train"]]
        command = [sys.executable, "-c", *launch, *overrides, f"runs_dir={folder}"]
        # What goes wrong is said on stderr.
        subprocess.run(
            command, cwd=checkout, env=environment, check=True, stdout=subprocess.DEVNULL
        )
        (metrics,) = Path(folder).rglob("metrics.jsonl")
        rows = [json.loads(line) for line in metrics.read_text().splitlines()][1:-1]
    return [{phase: row[f"time/{phase}_s"] for phase in PHASES} for row in rows]


if __name__ == "__main__":
    main()
