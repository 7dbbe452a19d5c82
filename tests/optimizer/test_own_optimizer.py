"""A researcher's own optimizer, outside the repository: the one that docs/architecture.md shows."""

import re
from pathlib import Path
from typing import Any

import pytest
import torch
from configured import make
from hydra import compose, initialize_config_module
from landscapes import Recorder, uneven_bowl

from tlr_exp.config.components import instantiate
from tlr_exp.config.load import ConfigError, load_settings
from tlr_exp.reward.objectives import RankDeviation
from tlr_exp.training.run import check_lower_layer

PAGE = Path(__file__).parents[2] / "docs" / "architecture.md"
GIVEN: dict[str, Any] = {"num_terms": 6, "objective": RankDeviation(0.1), "device": "cpu"}


@pytest.fixture
def settings_with(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """`settings_with(*overrides)`: of a run with the files of the page in another folder."""
    section = PAGE.read_text(encoding="utf-8").partition("### a weight optimizer")[2]
    code, settings = (
        re.findall(f"```{kind}\n(.*?)```", section, re.DOTALL)[0] for kind in ("python", "yaml")
    )
    (tmp_path / "optimizer").mkdir()
    (tmp_path / "optimizer" / "hill_climb.yaml").write_text(
        settings.replace("tlr_exp.optimizer.hill_climb", "own_hill_climb")
    )
    (tmp_path / "own_hill_climb.py").write_text(code)
    monkeypatch.syspath_prepend(tmp_path)

    def composed(*overrides: str):
        search = f"hydra.searchpath=[file://{tmp_path}]"
        with initialize_config_module("tlr_exp.conf", version_base="1.3"):
            return load_settings(compose("config", [search, *overrides]))

    return composed


def test_it_searches_and_goes_on_from_a_checkpoint_to_the_same_bits(settings_with) -> None:
    settings = settings_with("optimizer=hill_climb")
    check_lower_layer(settings)
    whole, resumed = (
        instantiate("optimizer", settings.optimizer, **GIVEN, seed=seed) for seed in (0, 1)
    )
    recorder = Recorder(uneven_bowl)
    found = whole.search(recorder)
    assert found.evaluations == recorder.calls == 1530
    assert found.value < make("random_search", num_terms=6).search(uneven_bowl).value
    resumed.load_state_dict(whole.state_dict())
    assert torch.equal(whole.search(uneven_bowl).position, resumed.search(uneven_bowl).position)


def test_its_settings_are_checked_before_a_run(settings_with) -> None:
    settings = settings_with("optimizer=hill_climb", "optimizer.step=-1.0")
    with pytest.raises(ConfigError, match=r"step is -1\.0; allowed: above 0"):
        check_lower_layer(settings)


def test_it_serves_inside_another(settings_with) -> None:
    settings = settings_with(
        "optimizer=effective_dimension", "optimizer@optimizer.inner=hill_climb"
    )
    recorder = Recorder(uneven_bowl)
    found = instantiate("optimizer", settings.optimizer, **GIVEN, seed=0).search(recorder)
    assert found.evaluations == recorder.calls == 1530
