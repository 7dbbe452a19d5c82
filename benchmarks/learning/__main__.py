"""Compare learning recipes: errors against control steps and against the time they take.

    python -m benchmarks.learning [VARIANT ...] --seeds 0,1

trains the variants of ``variants.yaml`` (static arm; one thread a run, two runs at a time), stops
those that are beaten, goes on where an earlier call was stopped, and draws all that it finds in
the runs folder, beside a CSV of the curves. ``--draw`` only draws.
"""

import argparse
from pathlib import Path

from benchmarks.learning.curves import draw, read_curve, run_of, save
from benchmarks.learning.training import train
from benchmarks.learning.variants import load_variants


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("variants", nargs="*", metavar="VARIANT", help="default: all")
    parser.add_argument("--seeds", default="0,1", help="comma-separated (default: 0,1)")
    parser.add_argument("--until", type=int, default=407, help="iterations (default: 407)")
    parser.add_argument(
        "--check-at", default="100,200", help="iterations at which beaten runs stop"
    )
    parser.add_argument("--parallel", type=int, default=2, help="runs at a time (default: 2)")
    parser.add_argument("--runs", type=Path, default=Path("runs/learning"))
    parser.add_argument("--draw", action="store_true", help="train nothing")
    parser.add_argument("-o", "--output", type=Path, default=Path("runs/learning/curves.png"))
    arguments = parser.parse_args()
    seeds, check_at = _numbers(arguments.seeds), _numbers(arguments.check_at)
    variants = load_variants(arguments.variants)
    runs_dir = arguments.runs.absolute()
    if not arguments.draw:
        train(variants, seeds, runs_dir, arguments.until, check_at, arguments.parallel)
    found = {
        (variant.name, seed): read_curve(run)
        for variant in variants
        for seed in seeds
        if (run := run_of(runs_dir / variant.name, seed)) is not None
    }
    for (name, seed), curve in found.items():
        print(f"{name:16} seed {seed}  {curve.summary()}")
    save(found, arguments.output.with_suffix(".csv"))
    draw(found, arguments.output)
    print(arguments.output)


def _numbers(text: str) -> list[int]:
    return [int(part) for part in text.split(",") if part]


if __name__ == "__main__":
    main()
