"""Lists in the documentation against what they are lists of."""

import re
import tomllib
from pathlib import Path

import pytest
import yaml

ROOT = Path(__file__).parents[1]
SWEEPS = sorted((ROOT / "conf" / "sweep").glob("*.yaml"))


def test_the_layers_of_the_architecture_are_those_that_are_checked():
    contracts = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["importlinter"]
    architecture = (ROOT / "docs" / "architecture.md").read_text()
    for contract in contracts["contracts"]:
        if contract["type"] == "layers":
            layers = [re.sub(r"tlr_exp\.|analysis\.", "", row) for row in contract["layers"]]
            rows = [layer.replace(" | ", ", ") for layer in layers]
            assert "\n".join(["```", *rows, "```"]) in architecture


@pytest.mark.parametrize("path", SWEEPS, ids=lambda path: path.stem)
def test_the_table_of_sweeps_says_what_each_one_runs(path):
    table = (ROOT / "docs" / "sweeps.md").read_text()
    (row,) = re.findall(rf"^\| `{path.stem}` \|.*\|$", table, flags=re.MULTILINE)
    params = yaml.safe_load(path.read_text())["hydra"]["sweeper"]["params"]
    seeds = [int(seed) for seed in str(params.pop("seed")).split(",")]
    assert (f"seeds {seeds[0]} to {seeds[-1]}" if seeds[1:] else f"seed {seeds[0]}") in row
    for key, value in params.items():
        values = str(value).split(",")
        if len(values) == 1:  # what all jobs have, or a pattern
            continue
        assert f"`{key}={value}`" in row or f"`{key}` from {values[0]} to {values[-1]}" in row


def test_every_sweep_of_the_table_exists():
    section = (ROOT / "docs" / "sweeps.md").read_text().partition("By name")[2]
    table = section.partition("The command line wins")[0]
    assert set(re.findall(r"^\| `(\w+)` \|", table, flags=re.MULTILINE)) == {
        path.stem for path in SWEEPS
    }
