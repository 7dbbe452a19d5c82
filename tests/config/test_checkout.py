"""Which YAML is read where tlr_exp is installed from one folder and run from another."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]
READ = """
import tlr_exp
from hydra import compose, initialize_config_module
from importlib.resources import files
with initialize_config_module("tlr_exp.conf", version_base="1.3"):
    print(compose("config").scale.iterations, tlr_exp.__file__, files("tlr_exp.conf"))
"""


def read_in(path: Path) -> list[str]:
    environment = {**os.environ, "PYTHONPATH": str(path)}
    command = [sys.executable, "-c", READ]
    ended = subprocess.run(
        command, cwd=path, env=environment, capture_output=True, text=True, check=True
    )
    return ended.stdout.split()


def test_a_second_checkout_reads_its_own_yaml(tmp_path):
    for name in ("tlr_exp", "conf"):
        shutil.copytree(ROOT / name, tmp_path / name, ignore=shutil.ignore_patterns("*.pyc"))
    shutil.copy(ROOT / "pyproject.toml", tmp_path)
    scale = tmp_path / "conf" / "scale" / "demo.yaml"
    text = scale.read_text()
    iterations = next(line for line in text.splitlines() if line.startswith("iterations:"))
    scale.write_text(text.replace(iterations, "iterations: 4321"))
    found, package, conf = read_in(tmp_path)
    assert found == "4321"
    assert Path(package).is_relative_to(tmp_path)
    assert conf == str(tmp_path / "conf")


def test_a_folder_that_is_no_checkout_is_left_alone(tmp_path):
    """As in site-packages, where a neighbour may be called conf."""
    shutil.copytree(ROOT / "tlr_exp", tmp_path / "tlr_exp")
    shutil.copytree(ROOT / "conf", tmp_path / "tlr_exp" / "conf")
    (tmp_path / "conf").mkdir()
    (tmp_path / "conf" / "config.yaml").write_text("nobody's: 1\n")
    _, _, conf = read_in(tmp_path)
    assert conf == str(tmp_path / "tlr_exp" / "conf")
