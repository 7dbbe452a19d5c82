"""The recipes of conf/recipe: complete, chosen by the scales, and beaten by what the user says."""

import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import pytest
import yaml
from hydra import compose, initialize_config_module

from tlr_exp.config.load import load_settings, plain_config
from tlr_exp.config.settings import PpoSettings
from tlr_exp.training.run import open_run

CONF = Path(__file__).parents[2] / "conf"
RECIPES = ("fast", "paper")
SCALES = {"demo": "fast", "laptop": "fast", "paper": "paper"}

# What every run learned by before there were recipes.
BEFORE = {
    "env.observation": "history",
    "env.action": "default_pose",
    "env.reference_lead": 1,
    "env.start_phase": "random",
    "env.termination.max_tilt": 0.8,
    "env.termination.distance_start_m": 1.5,
    "env.termination.distance_end_m": 0.3,
    "env.termination.tighten_rate": 2.5e-5,
    "env.termination.tighten_above_steps": 42,
    "env.termination.loosen_below_steps": 40,
    "ppo.num_steps": 24,
    "ppo.num_epochs": 5,
    "ppo.num_minibatches": 4,
    "ppo.gamma": 0.99,
    "ppo.gae_lambda": 0.95,
    "ppo.clip_epsilon": 0.2,
    "ppo.value_clip": 0.2,
    "ppo.critic_coeff": 1.0,
    "ppo.entropy_coeff": 0.01,
    "ppo.max_grad_norm": 1.0,
    "ppo.learning_rate": 1e-3,
    "ppo.min_learning_rate": 1e-5,
    "ppo.max_learning_rate": 1e-2,
    "ppo.target_kl": 0.01,
    "ppo.normalize_observations": True,
    "ppo.hidden_sizes": [512, 256, 128],
    "ppo.activation": "elu",
    "ppo.initial_std": 0.8,
}
# Keys that came later, at the values that change nothing.
LATER = {
    "ppo.final_learning_rate": None,
    "ppo.decay_from": 0.0,
    "ppo.std": "log",
    "env.termination.distance_max_m": None,
    "env.termination.mean_episodes": None,
}


def composed(*overrides: str, folder: Path | None = None) -> dict[str, Any]:
    more = [] if folder is None else [f"hydra.searchpath=[file://{folder}]"]
    with initialize_config_module("tlr_exp.conf", version_base="1.3"):
        return plain_config(compose("config", [*more, *overrides]))


def leaves(config: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    for name, value in config.items():
        if isinstance(value, Mapping):
            yield from leaves(value, f"{prefix}{name}.")
        else:
            yield f"{prefix}{name}", value


def stated(recipe: str) -> dict[str, Any]:
    """What the file of a recipe and that of its ppo say, by dotted key."""
    own = yaml.safe_load((CONF / "recipe" / f"{recipe}.yaml").read_text())
    (choice,) = [default["override /ppo"] for default in own.pop("defaults")]
    ppo = yaml.safe_load((CONF / "ppo" / f"{choice}.yaml").read_text())
    return dict(leaves({**own, "ppo": ppo}))


def learned_by(config: Mapping[str, Any]) -> dict[str, Any]:
    """The part of a configuration that a recipe states."""
    every = dict(leaves(config))
    return {key: every[key] for key in stated("paper")}


# --- what a recipe states --------------------------------------------------------------------


def test_both_recipes_state_all_that_a_recipe_decides():
    assert stated("fast").keys() == stated("paper").keys() == {"recipe", *BEFORE, *LATER}
    ppo = {f"ppo.{name}" for name in PpoSettings.__annotations__}
    assert ppo == {key for key in stated("fast") if key.startswith("ppo.")}


def test_the_paper_s_recipe_is_what_was_learned_by_before_there_were_recipes():
    assert learned_by(composed("recipe=paper")) == {"recipe": "paper", **BEFORE, **LATER}


def test_the_fast_recipe_differs_where_the_documentation_says_so():
    fast, paper = stated("fast"), stated("paper")
    assert {key for key in paper if fast[key] != paper[key]} == {
        *("recipe", "env.observation", "env.action", "env.termination.distance_start_m"),
        *("ppo.initial_std", "ppo.entropy_coeff"),
        *("ppo.target_kl", "ppo.final_learning_rate", "ppo.gamma", "ppo.hidden_sizes"),
    }


# --- who chooses -----------------------------------------------------------------------------


@pytest.mark.parametrize("scale", SCALES)
def test_a_scale_chooses_its_recipe(scale):
    assert learned_by(composed(f"scale={scale}")) == stated(SCALES[scale])


def test_the_default_is_the_demo_s():
    assert composed() == composed("scale=demo")


@pytest.mark.parametrize("scale", SCALES)
@pytest.mark.parametrize("recipe", RECIPES)
def test_a_command_chooses_any_recipe_for_any_scale(scale, recipe):
    for words in ([f"scale={scale}", f"recipe={recipe}"], [f"recipe={recipe}", f"scale={scale}"]):
        config = composed(*words)
        assert learned_by(config) == stated(recipe)
        assert config["scale"]["name"] == scale
        load_settings(config)


@pytest.mark.parametrize("recipe", RECIPES)
def test_a_single_value_goes_before_the_recipe_s(recipe):
    changes = {"env.action": "current_pose", "ppo.gamma": 0.9, "env.termination.max_tilt": 0.5}
    config = composed(f"recipe={recipe}", *(f"{key}={value}" for key, value in changes.items()))
    assert learned_by(config) == {**stated(recipe), **changes}


def test_another_ppo_goes_before_the_recipe_s():
    config = composed("scale=laptop", "ppo=paper")
    ppo = {key: value for key, value in stated("paper").items() if key.startswith("ppo.")}
    assert learned_by(config) == {**stated("fast"), **ppo}


@pytest.mark.parametrize("scale", SCALES)
def test_what_an_environment_of_one_s_own_says_goes_before_the_recipe(tmp_path, scale):
    (tmp_path / "env").mkdir()
    mine = {"defaults": ["gym_motion", "_self_"], "termination": {"max_tilt": 0.6}}
    (tmp_path / "env/mine.yaml").write_text(yaml.safe_dump(mine))
    config = composed("env=mine", f"scale={scale}", folder=tmp_path)
    assert learned_by(config) == {**stated(SCALES[scale]), "env.termination.max_tilt": 0.6}


# --- what is recorded ------------------------------------------------------------------------


@pytest.mark.parametrize("recipe", RECIPES)
def test_a_run_names_its_recipe(tmp_path, recipe):
    config = composed(f"recipe={recipe}", f"runs_dir={tmp_path}")
    run = open_run(load_settings(config), config, "gwo", go_on=False)
    assert json.loads((run.path / "manifest.json").read_text())["tags"]["recipe"] == recipe
    assert run.config["recipe"] == recipe
    assert learned_by(run.config) == stated(recipe)
