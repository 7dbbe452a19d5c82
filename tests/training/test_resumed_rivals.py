"""Readings and rivals that keep something between iterations: a resumed run has the same bits."""

import shutil

import pytest
import torch
from learners import build_training

from tlr_exp.keys import TIME_PREFIX
from tlr_exp.records.checkpoint import load_checkpoint
from tlr_exp.records.run_directory import RunDirectory

TINY = (
    "scale.num_envs=16",
    "scale.iterations=4",
    "scale.checkpoint_every=2",
    "scale.evaluate_every=4",
    "ppo.num_steps=8",
    "ppo.hidden_sizes=[16]",
    "num_threads=1",
    "physics.num_threads=1",
)
STAGES = (
    "[{enter_when:{},weights:{ang_vel_xy:0.0},distance_m:0.9,start_phases:[0.0,0.1]},"
    "{enter_when:{iteration:1},weights:{ang_vel_xy:0.5},distance_m:null,start_phases:[0.5,1.0]},"
    "{enter_when:{iteration:3},weights:{},distance_m:0.7,start_phases:null}]"
)
CHOICES = [
    ["reward.ranked=episode"],
    ["reward.ranked=per_step"],
    ["reward.ranked=age_matched"],
    ["optimizer=smoothed"],
    ["optimizer=under_curriculum", "reward/objective=normalized"],
    ["reward=shaping"],
    ["reward.sigma_rate=0.05"],
    ["curriculum=hierarchical", f"stages={STAGES}"],
]


def learned(run: RunDirectory) -> list[dict]:
    """Its metrics without what the clock says."""
    ignored = (TIME_PREFIX, "wall_time")
    return [
        {key: value for key, value in line.items() if not key.startswith(ignored)}
        for line in run.metrics()
    ]


def tensors(value: object) -> list[torch.Tensor]:
    if isinstance(value, dict):
        return [tensor for part in value.values() for tensor in tensors(part)]
    return [value] if isinstance(value, torch.Tensor) else []


@pytest.mark.parametrize("overrides", CHOICES, ids=" ".join)
def test_a_resumed_run_ends_with_the_same_bits(tmp_path, settings_of, overrides):
    settings = settings_of(*TINY, *overrides)
    run = RunDirectory.create(tmp_path / "run", {"seed": 0}, {})
    build_training(settings, run).train()
    shutil.copytree(run.path, tmp_path / "resumed")
    resumed = RunDirectory.open(tmp_path / "resumed")
    last = "checkpoints/000004.pt"
    (resumed.path / last).unlink()
    training = build_training(settings, resumed)
    assert training.done == 2
    training.train()
    assert len(learned(run)) == 4
    assert learned(resumed) == learned(run)
    states = [tensors(load_checkpoint(each.path / last)) for each in (run, resumed)]
    assert all(torch.equal(a, b) for a, b in zip(*states, strict=True))
