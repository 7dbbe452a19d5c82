"""Mistakes in overrides leave at once, with the keys that exist."""

import pytest
from hydra import initialize_config_module

from tlr_exp.config.overrides import explain_mistakes, split_overrides


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["ppo.gama=0.9"], ["no key ppo.gama", "Did you mean gamma?", "num_steps"]),
        (["optimizer=gwoo"], ["optimizer/gwoo", "fixed", "gwo", "random"]),
        (["sede=1"], ["no key sede", "Did you mean seed?"]),
        (["seed"], ["seed"]),
        (["seed=1", "optimizer.pack=3"], ["no key optimizer.pack", "pack_size"]),
        (["-m", "optimizer=fixed,gwo", "scale.num_env=1,2"], ["no key scale.num_env", "num_envs"]),
        (["ppo=null"], ["ppo"]),
        (["-m", "seed=range(3)", "ppo.gama=1"], ["no key ppo.gama"]),
        (["+sweep=five_sedes"], ["sweep/five_sedes", "five_seeds", "controls"]),
        (["+sweep=five_seeds", "seed=0,1", "scale=demos"], ["scale/demos", "laptop"]),
        (
            ["-m", "ppo.gamma=interval(0,1)"],
            ["interval(0,1): a sweep needs single values"],
        ),
        (["-m", "env=glob(no*)"], ["env=glob(no*): there is nothing that it could mean"]),
        (["-m", "hydra/sweeper=optuna"], ["hydra/sweeper: a sweep of tlr-train", "leave it out"]),
        (["-m", "hydra/sweeper=basic"], ["hydra/sweeper: a sweep of tlr-train", "leave it out"]),
        (["-m", "hydra/launcher=nope"], ["hydra/launcher/nope", "ray_cluster", "slurm"]),
        (["reward/objective=nope"], ["reward/objective/nope", "kendall"]),
    ],
)
def test_a_mistake_leaves_with_an_explanation(arguments, words, capsys):
    with pytest.raises(SystemExit) as left:
        explain_mistakes(arguments)
    assert left.value.code == 2
    printed = capsys.readouterr().err
    for word in words:
        assert word in printed


@pytest.mark.parametrize(
    "arguments",
    [
        [],
        ["optimizer=fixed", "seed=3"],
        ["-m", "seed=0,1"],
        ["-m", "seed=range(3)", "env=glob(*)", "ppo.gamma=choice(0.9,0.99)"],
        ["+sweep=five_seeds", "seed=0,1"],
        ["--help"],
        ["+new.key=1"],
    ],
)
def test_what_is_right_or_hydras_own_passes(arguments):
    explain_mistakes(arguments)


def test_a_list_a_range_a_choice_and_a_glob_are_sweeps():
    several = ["seed=0,1", "ppo.num_epochs=range(2,6,2)", "device=choice(cpu,cuda)"]
    with initialize_config_module("tlr_exp.conf", version_base="1.3"):
        assert split_overrides([*several, "env=glob(gym*)"]) == {
            "seed": ["seed=0", "seed=1"],
            "ppo.num_epochs": ["ppo.num_epochs=2", "ppo.num_epochs=4"],
            "device": ["device=cpu", "device=cuda"],
            "env": ["env=gym_motion"],
        }
        assert split_overrides(["seed=0,1", "ppo.hidden_sizes=[1,2]", "seed=3"]) == {
            "seed": ["seed=3"],
            "ppo.hidden_sizes": ["ppo.hidden_sizes=[1,2]"],
        }
