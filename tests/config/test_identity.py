"""Which run a configuration is: what counts, what does not, and that earlier runs keep theirs."""

import pytest
from hydra import compose, initialize_config_module

from tlr_exp.config import input_files
from tlr_exp.config.identity import ALWAYS_IDENTITY, NOT_IDENTITY, run_identity
from tlr_exp.config.input_files import file_hashes
from tlr_exp.config.load import (
    ConfigError,
    plain_config,
    with_absolute_paths,
)
from tlr_exp.config.nested import value_at, with_value
from tlr_exp.config.versions import ADDED_KEYS, of_any_version
from tlr_exp.records.runs import config_hash


def composed(*overrides):
    with initialize_config_module("tlr_exp.conf", version_base="1.3"):
        return compose("config", list(overrides))


def identity_of(*overrides):
    return run_identity(with_absolute_paths(plain_config(composed(*overrides))))


def test_an_authored_motion_counts_by_what_its_keyframes_say(tmp_path, monkeypatch):
    """Not by its name alone, nor by a file of that name in the current folder."""
    before = identity_of("env.motion=walk")
    (tmp_path / "walk").write_text("mine")
    monkeypatch.chdir(tmp_path)
    assert identity_of("env.motion=walk") == before
    (tmp_path / "walk.yaml").write_bytes(input_files.motion_content("walk"))
    assert identity_of("env.motion=walk.yaml") == before
    monkeypatch.setattr(input_files, "files", lambda _: tmp_path)  # where the motions lie
    assert identity_of("env.motion=walk") == before
    with (tmp_path / "walk.yaml").open("a") as file:
        file.write("# edited")
    assert identity_of("env.motion=walk") != before


def test_files_count_by_what_they_hold_and_not_by_where_they_lie(tmp_path):
    for folder, motion, model in (("a", "one", "<x/>"), ("b", "one", "<x/>"), ("c", "two", "<y/>")):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "m.npz").write_text(motion)
        (tmp_path / folder / "r.xml").write_text(model)

    def identity(motion, model):
        paths = [tmp_path / motion / "m.npz", tmp_path / model / "r.xml"]
        return identity_of(f"env.motion={paths[0]}", f"env.robot.mjcf={paths[1]}")

    assert identity("a", "a") == identity("b", "b")
    assert len({identity(motion, model) for motion in "ac" for model in "ac"}) == 4


def test_a_beginning_counts_by_what_the_checkpoint_holds(tmp_path):
    for name, weights in (("a", "one"), ("b", "one"), ("c", "two")):
        folder = tmp_path / name / "checkpoints"
        folder.mkdir(parents=True)
        (folder / "000003.pt").write_text(weights)
        (folder / "000007.pt").write_text("later")
        (folder / "scores.json").write_text('{"3": 0.5, "7": 0.1}')

    def config(place):
        return with_absolute_paths(plain_config(composed(f"init_from={tmp_path / place}")))

    best = tmp_path / "a/checkpoints/000003.pt"
    assert config("a")["init_from"] == config(best)["init_from"] == str(best)
    assert run_identity(config("a")) == run_identity(config("b")) == run_identity(config(best))
    identities = {run_identity(config(name)) for name in ("a", "c", "a/checkpoints/000007.pt")}
    assert len({*identities, identity_of()}) == 4
    assert run_identity(config("a"), file_hashes(config("c"))) == run_identity(config("c"))
    with pytest.raises(ConfigError, match="init_from: there is no folder"):
        config("nowhere")


def test_the_identity_ignores_where_a_run_is_kept_and_nothing_that_it_learns_from():
    def identity(*overrides):
        return config_hash(plain_config(composed(*overrides)), NOT_IDENTITY)

    assert identity() == identity("runs_dir=elsewhere", "resume=auto", "tracking_uri=none")
    assert identity() == identity("physics.num_threads=1", "scale.checkpoint_every=3")
    assert identity() != identity("seed=1")
    assert identity() != identity("optimizer=fixed")
    assert identity() != identity("ppo.gamma=0.97")


@pytest.mark.parametrize(
    ("identity", "overrides"),
    [  # computed by the last version before keys could be left out of an identity
        ("aa5ac3ae", []),
        ("b6fe38bb", ["optimizer=fixed", "seed=1"]),
        ("cd2d6d13", ["reward.penalty_scale=0.5"]),
        ("8d9bd5f7", ["scale=laptop", "physics=mjx"]),
        ("6a0a6faa", ["reward=asap", "optimizer=cma_es"]),
    ],
)
def test_runs_keep_the_identity_that_earlier_versions_gave_them(tmp_path, identity, overrides):
    motion = tmp_path / "motion.npz"
    motion.write_bytes(b"a motion")
    config = plain_config(composed("recipe=paper", f"env.motion={motion}", *overrides))
    assert run_identity(config) == identity
    for key in set(ADDED_KEYS) - set(ALWAYS_IDENTITY):  # as such a run's own file has it
        *parents, name = key.split(".")
        group = config
        for parent in parents:
            group = group[parent]
        del group[name]
    assert run_identity(config) == run_identity(of_any_version(config)) == identity


@pytest.mark.parametrize("group", ["env.noise", "env.disturbance"])
def test_a_later_group_counts_once_any_of_its_values_is_another(group):
    """The default choice is what earlier runs did; a group that is there stays as it is."""
    config = plain_config(composed())
    assert value_at(config, group) == ADDED_KEYS[group]
    without = with_value(config, group, None)
    del without["env"][group.rpartition(".")[2]]
    assert of_any_version(without) == of_any_version(config)
    assert run_identity(without) == run_identity(config)
    name = next(iter(ADDED_KEYS[group]))
    changed = with_value(config, f"{group}.{name}", "another")
    assert of_any_version(changed) == changed
    assert run_identity(changed) != run_identity(config)


def test_a_later_key_counts_once_it_has_another_value_than_earlier_runs_had(monkeypatch):
    before = plain_config(composed())
    monkeypatch.setitem(ADDED_KEYS, "ppo.later", 0.5)
    monkeypatch.setitem(ADDED_KEYS, "later", None)

    def identity(in_ppo, alone):
        return run_identity({**before, "ppo": {**before["ppo"], "later": in_ppo}, "later": alone})

    assert identity(0.5, None) == run_identity(before)
    assert len({identity(0.5, None), identity(0.25, None), identity(0.5, "a")}) == 3
    # Always told, because runs that have it count it.
    penalty = {**before["reward"], "penalty_scale": 1.0}
    without = {name: value for name, value in penalty.items() if name != "penalty_scale"}
    assert run_identity({**before, "reward": penalty}) == run_identity(before)
    assert run_identity({**before, "reward": without}) != run_identity(before)
