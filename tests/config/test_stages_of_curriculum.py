"""Stages of a curriculum that cannot be, told by their key; and what counts in a run's identity."""

import pytest
from hydra import compose, initialize_config_module

from tlr_exp.config.identity import run_identity
from tlr_exp.config.load import ConfigError, load_settings, plain_config


def composed(*overrides):
    with initialize_config_module("tlr_exp.conf", version_base="1.3"):
        return compose("config", list(overrides))


def stage(enter_when="{}", weights="{}", distance_m="null", start_phases="null"):
    return (
        f"{{enter_when:{enter_when},weights:{weights},distance_m:{distance_m},"
        f"start_phases:{start_phases}}}"
    )


@pytest.mark.parametrize(
    ("stages", "words"),
    [
        ([stage("{iteration:3}")], ["stages[0].enter_when", "a run begins in this stage"]),
        ([stage(), stage()], ["stages[1].enter_when", "at least one of iteration"]),
        ([stage(), stage("{height:3}")], ["stages[1].enter_when is 'height'", "body_error_m"]),
        ([stage(), stage("{iteration:-1}")], ["stages[1].enter_when.iteration is -1.0"]),
        ([stage(), stage("{goal_share:1.1}")], ["enter_when.goal_share is 1.1", "from 0 to 1"]),
        ([stage(weights="{torques:1}")], ["stages[0].weights is 'torques'", "lin_vel_z"]),
        ([stage(weights="{body_pos:1}")], ["stages[0].weights is 'body_pos'", "base_height"]),
        ([stage(weights="{ang_vel_xy:2}")], ["stages[0].weights.ang_vel_xy is 2.0", "from 0 to 1"]),
        ([stage(distance_m="0")], ["stages[0].distance_m is 0.0", "above 0"]),
        ([stage(start_phases="[0.5]")], ["stages[0].start_phases is [0.5]", "[first, last]"]),
        ([stage(start_phases="[0.5,0.2]")], ["stages[0].start_phases", "in order"]),
    ],
)
def test_stages_that_cannot_be_are_told_by_key(stages, words):
    with pytest.raises(ConfigError) as error:
        load_settings(composed("optimizer=staged", f"stages=[{','.join(stages)}]"))
    assert all(word in str(error.value) for word in words)


def test_weights_need_an_optimizer_that_applies_them():
    given = f"stages=[{stage(weights='{ang_vel_xy:0.5}')}]"
    with pytest.raises(ConfigError, match=r"stages\[0\]\.weights are applied by no optimizer"):
        load_settings(composed("optimizer=gwo", given))
    inside = ("optimizer=smoothed", "optimizer@optimizer.inner=staged", given)
    assert load_settings(composed(*inside)).stages[0].weights == {"ang_vel_xy": 0.5}


def test_stages_name_terms_that_the_reward_has():
    reward = ("optimizer=staged", "reward=asap", f"stages=[{stage(weights='{torques:0.5}')}]")
    assert load_settings(composed(*reward)).stages[0].weights == {"torques": 0.5}
    with pytest.raises(ConfigError) as error:
        load_settings(composed("curriculum=hierarchical", "reward=asap"))
    assert "stages[0].weights is 'base_height'; allowed: dof_pos_limits" in str(error.value)


@pytest.mark.parametrize("around", [[], ["optimizer@optimizer.inner=staged"]])
def test_an_optimizer_of_stages_needs_stages(around):
    chosen = ["optimizer=smoothed", *around] if around else ["optimizer=staged"]
    with pytest.raises(ConfigError, match=r"stages is empty, .*curriculum=hierarchical"):
        load_settings(composed(*chosen))
    assert load_settings(composed(*chosen, f"stages=[{stage()}]")).stages


def test_a_part_of_the_motion_needs_random_starts():
    given = f"stages=[{stage(start_phases='[0,0.5]')}]"
    with pytest.raises(ConfigError, match=r"needs env\.start_phase=random, which is adaptive"):
        load_settings(composed("env.start_phase=adaptive", given))


def test_a_curriculum_is_one_word_and_counts_by_its_stages():
    settings = load_settings(composed("curriculum=hierarchical"))
    assert [len(each.weights) for each in settings.stages] == [6, 3, 0]
    assert settings.optimizer["_target_"].endswith("StagedWeights")
    assert load_settings(composed()).stages == []
    config = plain_config(composed("optimizer=staged"))
    staged = plain_config(composed("curriculum=hierarchical"))
    assert run_identity({**config, "curriculum": "of another name"}) == run_identity(config)
    assert run_identity(staged) != run_identity(config)
