"""Which number a study sweeps, read from the configurations of its runs."""

import json
from dataclasses import replace

import numpy as np
import pytest
from studies import make_study

from analysis.data.study import StudyError
from analysis.measures.swept import end_of_training, sweep_of
from tlr_exp import keys

SHARES = ("gwo, threshold_share=0.5", "gwo, threshold_share=0.02", "gwo, threshold_share=0.1")


def study_of(*arms: str):
    return make_study(np.random.default_rng(0), arms, seeds=[0, 1], iterations=10, noise=0)


def with_setting(study, arm: str, group: str, name: str, value):
    """The study with one setting of an arm's configuration replaced."""
    configs = []
    for each, text in zip(study.runs["arm"], study.runs["config"], strict=True):
        config = json.loads(text)
        if each == arm:
            config[group][name] = value
        configs.append(json.dumps(config))
    return replace(study, runs=study.runs.assign(config=configs))


def test_values_are_in_order_of_size():
    sweep = sweep_of(study_of(*SHARES))
    assert sweep.key == "reward.objective.threshold_share"
    assert list(sweep.lines) == ["gwo"]
    assert list(sweep.lines["gwo"].items()) == [
        (0.02, "gwo, threshold_share=0.02"),
        (0.1, "gwo, threshold_share=0.1"),
        (0.5, "gwo, threshold_share=0.5"),
    ]
    assert sweep.values == (0.02, 0.1, 0.5)
    assert sweep.references == {}


def test_an_arm_without_the_setting_is_a_reference():
    sweep = sweep_of(study_of("fixed", "gwo, pack_size=5", "gwo, pack_size=30"))
    assert sweep.key == "optimizer.pack_size"
    assert sweep.lines == {"gwo": {5.0: "gwo, pack_size=5", 30.0: "gwo, pack_size=30"}}
    assert sweep.references == {"fixed": "fixed"}


def test_two_methods_are_two_lines():
    arms = [f"{m}, threshold_share={v}" for m in ("gwo", "random") for v in (0.1, 0.5)]
    sweep = sweep_of(study_of(*arms))
    assert {method: list(line) for method, line in sweep.lines.items()} == {
        "gwo": [0.1, 0.5],
        "random": [0.1, 0.5],
    }


def test_methods_alone_sweep_no_number():
    assert sweep_of(study_of("fixed", "gwo", "random")) is None


def test_a_grid_has_no_one_axis():
    arms = [f"gwo, threshold_share={s}, pack_size={p}" for s in (0.1, 0.5) for p in (5, 30)]
    assert sweep_of(study_of(*arms)) is None


def test_words_and_switches_are_no_numbers():
    study = study_of("gwo, threshold_share=0.1", "gwo, threshold_share=0.5")
    first, second = study.arms
    for values in (("first", "largest_norm"), (True, False)):
        each = with_setting(study, second, "reward", "objective", {"threshold_share": 0.1})
        each = with_setting(each, first, "optimizer", "tie_break", values[0])
        each = with_setting(each, second, "optimizer", "tie_break", values[1])
        assert sweep_of(each) is None


def test_settings_that_change_nothing_learned_do_not_count():
    study = study_of("gwo, threshold_share=0.1", "gwo, threshold_share=0.5")
    with_cadence = with_setting(study, study.arms[0], "scale", "evaluate_every", 7)
    assert sweep_of(with_cadence) == sweep_of(study)


def test_end_of_training_is_the_last_fifth():
    """Of ten iterations the last two: means (1 + 3) / 2 and (10 + 30) / 2."""
    study = study_of("fixed", "gwo")
    curves = study.curves.copy()
    for seed, factor in ((0, 1.0), (1, 10.0)):
        rows = (curves["arm"] == "gwo") & (curves["seed"] == seed)
        curves.loc[rows, keys.EPISODE_LENGTH] = factor * np.array([9.0] * 8 + [1.0, 3.0])
    found = end_of_training(replace(study, curves=curves), keys.EPISODE_LENGTH, "gwo")
    assert found.tolist() == [2.0, 20.0]
    with pytest.raises(StudyError, match="no metric 'absent'"):
        end_of_training(study, "absent", "gwo")
