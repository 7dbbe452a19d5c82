"""The benchmark of whole trainings, on a checkout whose tlr-train only writes what it took."""

from pathlib import Path

from benchmarks.training_speed import PHASES, train

TRAIN = f"""
import json, sys
from pathlib import Path
from tlr_exp import conf

def main():
    *overrides, place = sys.argv[1:]
    rows = [
        {{f"time/{{phase}}_s": conf.SECONDS + number for phase in {PHASES}}}
        for number in range(int(overrides[0].removeprefix("scale.iterations=")))
    ]
    file = Path(place.removeprefix("runs_dir="), "metrics.jsonl")
    file.write_text("".join(json.dumps(row) + "\\n" for row in rows))
"""


def test_a_checkout_trains_by_its_own_package_and_configuration(tmp_path: Path) -> None:
    (tmp_path / "tlr_exp").mkdir()
    (tmp_path / "tlr_exp/__init__.py").touch()
    (tmp_path / "tlr_exp/begin.py").write_text(TRAIN)
    (tmp_path / "pyproject.toml").write_text(
        '[project.scripts]\ntlr-train = "tlr_exp.begin:main"\n'
    )
    (tmp_path / "conf").mkdir()
    (tmp_path / "conf/__init__.py").write_text("SECONDS = 5.0\n")
    rows = train(tmp_path, ["scale.iterations=4"])
    # Without the first iteration, which warms up, and the last, which evaluates.
    assert rows == [dict.fromkeys(PHASES, 6.0), dict.fromkeys(PHASES, 7.0)]
