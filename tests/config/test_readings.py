"""Readings of the paper's method: each changes one point, and is a run of its own."""

from pathlib import Path

import pytest
import yaml
from hydra import compose, initialize_config_module

import conf
from tlr_exp.config.identity import run_identity
from tlr_exp.config.load import ConfigError, load_settings, plain_config
from tlr_exp.config.nested import covers, flat
from tlr_exp.config.words import WORDS

CONF = Path(conf.__path__[0])
READINGS = sorted(path.stem for path in (CONF / "reading").glob("*.yaml") if path.stem != "none")


def config_of(*overrides):
    with initialize_config_module("tlr_exp.conf", version_base="1.3"):
        return plain_config(compose("config", list(overrides)))


@pytest.mark.parametrize("reading", READINGS)
def test_a_reading_changes_one_part_of_the_configuration_and_its_identity(reading):
    paper, other = config_of("recipe=paper"), config_of("recipe=paper", f"reading={reading}")
    assert run_identity(other) != run_identity(paper)
    keys = {*flat(paper)} | {*flat(other)}
    changed = {key for key in keys if flat(paper).get(key) != flat(other).get(key)}
    groups = ("reward.", "optimizer.", "env.termination.", "env.robot.", "ppo.std")
    assert sum(any(key.startswith(group) for key in changed) for group in groups) == 1


@pytest.mark.parametrize("word", WORDS)
def test_a_word_is_recorded_and_changes_only_the_keys_that_it_is_said_to_stand_for(word):
    before = flat(config_of("recipe=paper"))
    for choice in sorted(path.stem for path in (CONF / word).glob("*.yaml")):
        after = flat(config_of("recipe=paper", f"{word}={choice}"))
        assert after[word] == choice
        changed = {key for key in {*before, *after} if before.get(key) != after.get(key)}
        assert all(covers([word, *WORDS[word]], key) for key in changed)


def test_no_reading_is_what_there_was_before_and_the_sweep_has_them_all():
    assert run_identity(config_of("reading=none")) == run_identity(config_of())
    sweep = yaml.safe_load((CONF / "sweep" / "readings.yaml").read_text())
    values = sweep["hydra"]["sweeper"]["params"]["reading"].split(",")
    assert values[0] == "none"
    assert sorted(values[1:]) == READINGS


def test_a_curriculum_and_a_reading_can_be_chosen_beside_another_optimizer():
    assert (
        config_of("optimizer=pso", "reading=episode")["optimizer"]
        == (config_of("optimizer=pso")["optimizer"])
    )


def choosing():
    """(reading, group that it chooses, each other choice of this group)."""
    for reading in READINGS:
        content = yaml.safe_load((CONF / "reading" / f"{reading}.yaml").read_text())
        for default in content.get("defaults", []):
            ((override, choice),) = default.items()
            group = override.removeprefix("override /")
            others = {path.stem for path in (CONF / group).glob("*.yaml")} - {choice}
            yield from ((reading, group, other) for other in sorted(others))


# One other choice of most groups is as good as any.
@pytest.mark.parametrize(
    ("reading", "group", "other"),
    [each for each in choosing() if each[1] == "reward" or each[2] in ("fixed", "pso", "kendall")],
)
def test_a_reading_whose_choice_of_a_part_did_not_take_is_refused(reading, group, other):
    assert load_settings(config_of(f"reading={reading}")).reading == reading
    message = f"reading={reading} chooses {group}={reading}, .* leave out reading={reading} or"
    with pytest.raises(ConfigError, match=message):
        load_settings(config_of(f"reading={reading}", f"{group}={other}"))


def test_a_reading_and_another_part_go_together_where_one_is_inside_the_other():
    inside = config_of("reading=smoothed", "optimizer@optimizer.inner=fixed")
    assert load_settings(inside).optimizer["inner"]["_target_"].endswith("FixedWeights")
    around = ("optimizer=under_curriculum", "optimizer@optimizer.inner=smoothed")
    assert load_settings(config_of("reading=smoothed", *around)).reading == "smoothed"


def test_a_curriculum_and_a_reading_that_both_choose_the_optimizer_are_refused():
    with pytest.raises(ConfigError, match="weights are applied by no optimizer here"):
        load_settings(config_of("reading=smoothed", "curriculum=hierarchical"))


@pytest.mark.parametrize("recipe", ["fast", "paper"])
def test_the_distance_rule_is_asap_s_under_each_recipe(recipe):
    termination = config_of(f"recipe={recipe}", "reading=asap_distance")["env"]["termination"]
    distances = {key: value for key, value in termination.items() if key.startswith("distance")}
    assert distances == {"distance_start_m": 1.5, "distance_end_m": 0.3, "distance_max_m": 2.0}
    assert termination["mean_episodes"] == 10000
