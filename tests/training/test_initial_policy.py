"""A new run begins with the networks of a checkpoint and with nothing else of it."""

import dataclasses

import pytest
import torch
from learners import build_training

from tlr_exp import keys
from tlr_exp.assembly.learner import build_ppo
from tlr_exp.config.load import ConfigError
from tlr_exp.records.checkpoint import CheckpointError, CheckpointStore
from tlr_exp.records.run_directory import RunDirectory
from tlr_exp.training.initial_policy import begin_with, check_initial_policy

TINY = (
    *("scale.num_envs=16", "scale.iterations=1", "ppo.num_steps=4", "ppo.hidden_sizes=[16]"),
    *("num_threads=1", "physics.num_threads=1"),
)


@pytest.fixture(scope="module")
def trained(tmp_path_factory, settings_of):
    """A run of one iteration, so that its normalisation and its optimizer hold something."""
    settings = settings_of(*TINY)
    path = tmp_path_factory.mktemp("runs") / "old"
    training = build_training(settings, RunDirectory.create(path, dataclasses.asdict(settings), {}))
    training.train()
    return training


@pytest.fixture
def checkpoint(trained):
    return trained.store.best()


def policy_alone(trained, folder):
    """A checkpoint as it lies in a folder that holds a policy alone."""
    actor = trained.trainer.ppo.actor.state_dict()
    state = {"trainer": {"ppo": {"actor": actor}}}
    return CheckpointStore(folder / "checkpoints", keep_last=1).save(1, state)


def same(one: torch.nn.Module, other: torch.nn.Module) -> bool:
    pairs = zip(one.state_dict().values(), other.state_dict().values(), strict=True)
    return all(torch.equal(left, right) for left, right in pairs)


def test_the_first_actions_are_those_of_the_old_policy(trained, checkpoint, settings_of, tmp_path):
    settings = settings_of(*TINY, "seed=8", f"init_from={checkpoint}")
    run = RunDirectory.create(tmp_path / "new", dataclasses.asdict(settings), {})
    new = build_training(settings, run)
    assert new.done == 0
    batch = new.trainer.collect()
    with torch.no_grad():
        loc, scale, *_ = trained.trainer.ppo.actor.module[0](batch[keys.OBSERVATION])
    assert torch.equal(batch["loc"], loc)
    assert torch.equal(batch["scale"], scale)
    assert same(new.trainer.ppo.critic, trained.trainer.ppo.critic)


def test_the_optimizer_the_episodes_and_the_random_streams_are_new(
    trained, checkpoint, settings_of
):
    fresh, begun = (build_ppo(settings_of(*TINY, "seed=8")) for _ in range(2))
    assert begin_with(begun, checkpoint) == f"begins with the policy and the critic of {checkpoint}"
    assert same(begun.actor, trained.trainer.ppo.actor)
    assert trained.trainer.ppo.adam.state_dict()["state"]
    assert not begun.adam.state_dict()["state"]
    assert begun.learning_rate == fresh.learning_rate
    assert torch.equal(begun.generator.get_state(), fresh.generator.get_state())
    assert torch.equal(begun.exploration.get_state(), fresh.exploration.get_state())


def test_with_a_policy_alone_the_critic_is_new_and_that_is_said(trained, settings_of, tmp_path):
    path = policy_alone(trained, tmp_path)
    settings = settings_of(*TINY, "seed=8", f"init_from={tmp_path}")
    check_initial_policy(settings)
    fresh, begun = (build_ppo(settings) for _ in range(2))
    assert begin_with(begun, path).endswith("which holds no critic: that one is new")
    assert same(begun.actor, trained.trainer.ppo.actor)
    assert same(begun.critic, fresh.critic)


@pytest.mark.parametrize(
    ("overrides", "words"),
    [
        (["ppo.hidden_sizes=[16,8]"], ["ppo.hidden_sizes is [16] there, [16, 8] here"]),
        (
            ["env.observation=reference"],
            ["it sees 376 numbers (env.observation=history), env.observation=reference has 244"],
        ),
        (
            ["ppo.normalize_observations=false"],
            ["ppo.normalize_observations is true there, false here"],
        ),
        (["ppo.activation=relu"], ["ppo.activation is elu there, relu here"]),
        (["ppo.std=linear"], ["ppo.std is log there, linear here"]),
        (
            ["ppo.activation=relu", "ppo.hidden_sizes=[8]"],
            ["ppo.hidden_sizes is [16] there, [8] here", "ppo.activation is elu there, relu here"],
        ),
    ],
)
def test_other_networks_are_refused_with_what_differs(checkpoint, settings_of, overrides, words):
    settings = settings_of(*TINY, *overrides, f"init_from={checkpoint}")
    with pytest.raises(ConfigError) as error:
        check_initial_policy(settings)
    assert f"the policy of {checkpoint} does not fit this run" in str(error.value)
    assert [line.strip() for line in str(error.value).splitlines()[1:]] == words


def test_a_critic_or_an_actor_of_other_making_is_refused(trained, settings_of, tmp_path):
    ppo = trained.trainer.ppo.state_dict()
    narrow = {name: v[..., :5] if v.ndim == 2 else v for name, v in ppo["critic"].items()}
    renamed = {f"other.{name}": value for name, value in ppo["actor"].items()}
    store = CheckpointStore(tmp_path / "checkpoints", keep_last=2)
    for number, (state, words) in enumerate(
        [
            ({**ppo, "critic": narrow}, "its critic sees 5 numbers, that of this run 541"),
            ({**ppo, "actor": renamed}, "its actor is built otherwise: Missing key"),
        ]
    ):
        path = store.save(number, {"trainer": {"ppo": state}})
        with pytest.raises(ConfigError, match=words):
            check_initial_policy(settings_of(*TINY, f"init_from={path}"))
    with pytest.raises(CheckpointError, match="holds other networks"):
        begin_with(build_ppo(settings_of(*TINY)), path)


def test_what_is_there_not_and_what_holds_no_policy_is_told(settings_of, tmp_path):
    path = CheckpointStore(tmp_path / "checkpoints", keep_last=1).save(1, {"trainer": {}})
    for place, words in (
        (tmp_path / "nowhere", "init_from: there is no folder"),
        (path, "init_from: .*000001.pt holds no policy"),
    ):
        with pytest.raises(ConfigError, match=words):
            check_initial_policy(settings_of(*TINY, f"init_from={place}"))


def test_another_meaning_of_the_actions_is_said(checkpoint, settings_of, capsys):
    check_initial_policy(settings_of(*TINY, f"init_from={checkpoint}"))
    assert capsys.readouterr().out == ""
    check_initial_policy(settings_of(*TINY, "env.action=current_pose", f"init_from={checkpoint}"))
    said = capsys.readouterr().out
    assert "learned with env.action=default_pose; here it is current_pose" in said
