"""Settings that differ beyond what is compared are refused; arms are called by those that are."""

from dataclasses import replace

import pytest
from run_records import GWO, index, lines_of, records, set_in, with_setting

from analysis.data.check import checked, rechecked
from analysis.data.settings import arm_labels
from tlr_exp.config.identity import NOT_IDENTITY
from tlr_exp.config.nested import flat


# --- settings --------------------------------------------------------------------------------
def test_settings_that_differ_are_named_with_both_values() -> None:
    runs = set_in(records(), f"{GWO}2", "ppo.gamma", 0.9)
    name, example = runs[index(runs, f"{GWO}2")].name, runs[0].name
    assert lines_of(runs) == [f"{name}: ppo.gamma is 0.9, but 0.99 in {example} and 4 more"]


def test_a_setting_that_one_run_lacks_or_has_besides() -> None:
    runs = set_in(records(), f"{GWO}2", "env.reset_noise.root_pos_m", 0.1)
    (line,) = lines_of(runs)
    assert "env.reset_noise.root_pos_m is 0.1, but absent in" in line


def test_whole_numbers_equal_floats_but_not_texts_and_not_null() -> None:
    runs = [with_setting(run, "ppo.gamma", 1.0) for run in records()]
    assert checked(set_in(runs, f"{GWO}2", "ppo.gamma", 1)).is_finished
    assert len(lines_of(set_in(runs, f"{GWO}2", "ppo.gamma", "1.0"))) == 1
    assert len(lines_of(set_in(runs, f"{GWO}2", "env.robot.mjcf", "null"))) == 1
    assert len(lines_of(set_in(runs, f"{GWO}2", "ppo.hidden_sizes", [512, 256, 64]))) == 1


def test_a_key_that_is_null_is_as_good_as_one_that_earlier_versions_did_not_have() -> None:
    assert checked(set_in(records(), f"{GWO}2", "init_from", None)).is_finished
    assert len(lines_of(set_in(records(), f"{GWO}2", "init_from", "a.pt"))) == 1


def test_runs_from_before_and_after_a_move_of_the_classes_are_of_one_study() -> None:
    """Versions differ in where a class lies, and in the keys that they know."""
    runs = [
        with_setting(run, "reward.objective._target_", "tlr_exp.reward.objectives.Objective")
        for run in records()
    ]
    before = set_in(runs, f"{GWO}2", "optimizer._target_", "tlr_exp.optimizers.gwo.Gwo")
    before = set_in(before, f"{GWO}2", "reward.objective._target_", "tlr_exp.objective.Objective")
    after = set_in(before, f"{GWO}1", "reward.penalty_scale", 1.0)
    study = checked(after)
    assert study.arms == ("fixed", "gwo")
    assert rechecked(study).notes == study.notes == ()
    # Another class, or another value than earlier versions had, is still a difference.
    assert len(lines_of(set_in(after, f"{GWO}2", "optimizer._target_", "tlr_exp.optimizers.b.B")))
    assert len(lines_of(set_in(after, f"{GWO}1", "reward.penalty_scale", 0.5))) == 1


def test_within_an_arm_the_optimizers_settings_must_agree() -> None:
    runs = set_in(records(), f"{GWO}2", "optimizer.pack_size", 10)
    (line,) = lines_of(runs)
    assert line.startswith(runs[index(runs, f"{GWO}2")].name)
    assert "optimizer.pack_size is 10, but 30 in" in line
    # Between arms of different optimizers they do not: fixed has no pack.
    assert checked(records()).arms == ("fixed", "gwo")


@pytest.mark.parametrize("key", NOT_IDENTITY)
def test_settings_that_do_not_change_what_is_learned_may_differ(key: str) -> None:
    runs = set_in(records(), f"{GWO}2", key, 77)
    assert checked(runs).is_finished


def test_thread_counts_and_evaluation_steps_are_noted() -> None:
    runs = set_in(records(), f"{GWO}2", "num_threads", 2)
    (note,) = checked(runs).notes
    name = runs[index(runs, f"{GWO}2")].name
    assert note == f"num_threads differs: 1 in 5 runs; 2 in {name}"


def test_settings_can_be_ignored_by_key_or_group_and_are_noted() -> None:
    runs = set_in(records(), f"{GWO}2", "env.motion", "other/place.npz")
    assert len(lines_of(runs)) == 1
    for key in ("env.motion", "env"):
        (note,) = checked(runs, ignore=[key]).notes
        assert note.startswith("env.motion differs: gym_motion in 5 runs; other/place.npz in ")


# --- arms ------------------------------------------------------------------------------------
THRESHOLDS = ("fixed", "gwo, threshold_share=0.02", "gwo, threshold_share=0.1")
SHARE = "reward.objective.threshold_share"


def test_arms_by_further_keys() -> None:
    study = checked(records(THRESHOLDS), ["optimizer", SHARE])
    assert study.arms == ("fixed, threshold_share=0.1", *THRESHOLDS[1:])
    assert study.baseline == "fixed, threshold_share=0.1"
    assert len(lines_of(records(THRESHOLDS))) > 0


def test_arm_keys_that_do_not_differ_are_not_in_the_label() -> None:
    assert checked(records(), ["optimizer", SHARE, "ppo.gamma"]).arms == ("fixed", "gwo")


def test_arms_without_the_optimizer() -> None:
    runs = [run for run in records(THRESHOLDS) if run.method == "gwo"]
    study = checked(runs, [SHARE])
    assert study.arms == ("threshold_share=0.02", "threshold_share=0.1")
    assert checked(runs, [SHARE], baseline="threshold_share=0.1").arms[0] == "threshold_share=0.1"


def test_arms_by_a_word_may_differ_in_what_it_stands_for_and_in_nothing_else() -> None:
    values = {
        "none": ("reward.ranked", "segment"),
        "episode": ("reward.ranked", "episode"),
        "smoothed": ("optimizer.share", 0.1),
        "linear_std": ("ppo.std", "linear"),
    }
    runs = records(("gwo",), seeds=len(values) * 2)
    for number, (word, (key, value)) in enumerate([*values.items()] * 2):
        run = with_setting(with_setting(runs[number], "reading", word), key, value)
        runs[number] = with_setting(run, "seed", number // len(values))
    runs = [replace(run, seed=run.config["seed"]) for run in runs]
    study = checked(runs, ["reading"], baseline="reading=none")
    assert study.arms[0] == "reading=none"
    assert {*study.arms} == {f"reading={word}" for word in values}
    assert rechecked(study).arms == study.arms
    # Not what the word does not stand for, nor runs of one reading.
    (line,) = lines_of([with_setting(runs[0], "ppo.gamma", 0.9), *runs[1:]], ["reading"])
    assert "ppo.gamma is 0.9" in line
    lines = lines_of([with_setting(runs[0], "reward.ranked", "episode"), *runs[1:]], ["reading"])
    assert len(lines) == 1
    assert "reward.ranked is" in lines[0]


def test_labels_of_keys_with_the_same_end_and_of_exchangeable_parts() -> None:
    runs = [with_setting(run, "a.size", run.seed % 2) for run in records(("gwo",), seeds=2)]
    runs = [with_setting(run, "b.size", 5 + run.seed % 2) for run in runs]
    assert arm_labels(runs, ["optimizer", "a.size", "b.size"]) == [
        "gwo, a.size=0, b.size=5",
        "gwo, a.size=1, b.size=6",
    ]
    parts = [with_setting(run, "physics._target_", f"p.Engine{run.seed}") for run in runs]
    assert arm_labels(parts, ["optimizer", "physics"]) == [
        "gwo, physics=Engine0",
        "gwo, physics=Engine1",
    ]


def test_unknown_keys_are_refused_with_the_nearest() -> None:
    assert lines_of(records(), ["optimiser", "threshold_share"], ignore=["zzz"]) == [
        "no run has the configuration key optimiser; did you mean optimizer?",
        f"no run has the configuration key threshold_share; did you mean {SHARE}?",
        "no run has the configuration key zzz",
    ]


def test_flat_configurations() -> None:
    assert flat({"a": {"b": 1, "c": {}}, "d": [1, {"e": 2}], "f": None}) == {
        "a.b": 1,
        "a.c": {},
        "d": [1, {"e": 2}],
        "f": None,
    }
