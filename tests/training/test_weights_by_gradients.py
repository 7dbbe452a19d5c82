"""Trainings whose weights follow policy gradients: what they record, and that they resume."""

import math

import pytest
import torch
from learners import build_training

from tlr_exp import keys
from tlr_exp.records.run_directory import RunDirectory

TINY = (
    "scale.num_envs=16",
    "scale.evaluate_every=3",
    "ppo.num_steps=4",
    "ppo.hidden_sizes=[16]",
    "num_threads=1",
    "physics.num_threads=1",
)
RECORDED = {
    "gradnorm": ("gradient_ratio/ang_vel_xy", "gradient_cosine/ang_vel_xy"),
    "pcgrad": ("gradient_ratio/ang_vel_xy", "gradient_cosine/ang_vel_xy"),
    "meta_gradient": ("meta_gradient/ang_vel_xy", "meta_gradient_error/ang_vel_xy"),
}


@pytest.mark.parametrize("rival", RECORDED)
def test_a_training_resumes_to_the_same_bits_and_tells_of_gradients(tmp_path, settings_of, rival):
    def training(name: str, iterations: int):
        settings = settings_of(*TINY, f"optimizer={rival}", f"scale.iterations={iterations}")
        folder = tmp_path / name
        there = folder.exists()
        run = RunDirectory.open(folder) if there else RunDirectory.create(folder, {"seed": 0}, {})
        return build_training(settings, run)

    whole = training("whole", 3)
    whole.train()
    training("cut", 2).train()
    resumed = training("cut", 3)
    assert resumed.done == 2
    resumed.train()
    saved, found = (t.trainer.ppo.actor.state_dict() for t in (whole, resumed))
    assert all(torch.equal(saved[name], found[name]) for name in saved)
    for line in whole.run.metrics():
        weights = [value for name, value in line.items() if name.startswith(keys.WEIGHT_PREFIX)]
        assert len(weights) == 6
        assert all(0.0 <= weight <= 1.0 for weight in weights)
        for name in RECORDED[rival]:
            assert math.isfinite(line[keys.OPTIMIZER_PREFIX + name])
