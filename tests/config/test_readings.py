"""Readings of the paper's method: each changes one point, and is a run of its own."""

from pathlib import Path

import pytest
import yaml
from hydra import compose, initialize_config_module

import conf
from tlr_exp.config.identity import run_identity
from tlr_exp.config.load import plain_config
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
