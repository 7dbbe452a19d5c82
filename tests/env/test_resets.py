"""Noise on starting states: bounds, directions, limits and repeatability."""

import dataclasses

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from tlr_exp.config.settings import ResetNoise
from tlr_exp.env.resets import perturb

NUM_ENVS = 400
WIDE = torch.tensor([[-10.0, 10.0]]).expand(23, 2)


def noise(**half_widths: float) -> ResetNoise:
    zero = {field.name: 0.0 for field in dataclasses.fields(ResetNoise)}
    return ResetNoise(**{**zero, **half_widths})


@pytest.fixture
def start(random_frame) -> tuple[torch.Tensor, torch.Tensor]:
    frame = random_frame(NUM_ENVS)
    return frame.qpos, frame.qvel


def disturb(start, half_widths: ResetNoise, seed: int = 0, joint_range: torch.Tensor = WIDE):
    generator = torch.Generator().manual_seed(seed)
    return perturb(*start, half_widths, joint_range, generator)


def test_no_noise_leaves_the_reference_and_the_generator_as_they_are(start):
    generator = torch.Generator().manual_seed(0)
    before = generator.get_state()
    # Even joints beyond their range stay: the reference is copied as it is.
    narrow = torch.tensor([[-0.1, 0.1]]).expand(23, 2)
    qpos, qvel = perturb(*start, noise(), narrow, generator)
    assert torch.equal(qpos, start[0])
    assert torch.equal(qvel, start[1])
    assert torch.equal(generator.get_state(), before)


@pytest.mark.parametrize(
    ("name", "array", "columns"),
    [
        ("root_pos_m", "qpos", slice(0, 3)),
        ("joint_pos_rad", "qpos", slice(7, 30)),
        ("root_lin_vel", "qvel", slice(0, 3)),
        ("root_ang_vel", "qvel", slice(3, 6)),
        ("joint_vel", "qvel", slice(6, 29)),
    ],
)
def test_each_noise_is_uniform_within_its_half_width_and_touches_nothing_else(
    start, name, array, columns
):
    qpos, qvel = disturb(start, noise(**{name: 0.2}))
    changes = {"qpos": qpos - start[0], "qvel": qvel - start[1]}
    change = changes[array][:, columns].clone()
    changes[array][:, columns] = 0.0
    assert all(rest.abs().max() < 1e-6 for rest in changes.values())
    assert change.abs().max() <= 0.2 + 1e-6
    # At least 1200 draws of a uniform distribution of half-width 0.2: mean 0, standard
    # deviation 0.2/sqrt(3) = 0.115, of the mean 0.0033; both ends are reached.
    assert change.mean().abs() < 0.015
    assert change.std().item() == pytest.approx(0.1155, rel=0.05)
    assert change.max() > 0.18
    assert change.min() < -0.18
    assert change.unique().numel() > 0.9 * change.numel()


def test_rotation_noise_turns_each_root_within_bounds_about_world_axes(start):
    qpos, qvel = disturb(start, noise(root_rot_rad=0.3))
    assert torch.equal(qvel, start[1])
    assert torch.equal(qpos[:, :3], start[0][:, :3])
    torch.testing.assert_close(qpos[:, 3:7].norm(dim=1), torch.ones(NUM_ENVS), atol=1e-6, rtol=0)
    before, after = (
        Rotation.from_quat(q[:, 3:7].double().numpy(), scalar_first=True) for q in (start[0], qpos)
    )
    turn = (after * before.inv()).as_rotvec()
    assert np.abs(turn).max() <= 0.3 + 1e-5
    assert (np.abs(turn).max(axis=0) > 0.27).all()
    assert np.abs(turn.mean(axis=0)).max() < 0.04


def test_noise_leaves_joints_within_their_range(start, robot):
    joint_range = torch.tensor(robot.joint_range_rad, dtype=torch.float32)
    qpos, _ = disturb(start, noise(joint_pos_rad=3.0), joint_range=joint_range)
    assert (qpos[:, 7:] >= joint_range[:, 0]).all()
    assert (qpos[:, 7:] <= joint_range[:, 1]).all()


def test_same_generator_same_states(start):
    everything = noise(
        root_pos_m=0.1,
        root_rot_rad=0.1,
        root_lin_vel=0.1,
        root_ang_vel=0.1,
        joint_pos_rad=0.1,
        joint_vel=0.1,
    )
    first, again, other = (disturb(start, everything, seed) for seed in (3, 3, 4))
    for one, two, three in zip(first, again, other, strict=True):
        assert torch.equal(one, two)
        assert not torch.equal(one, three)


def test_start_states_are_not_written_to(start):
    kept = [value.clone() for value in start]
    disturb(start, noise(root_pos_m=1.0, joint_pos_rad=1.0, joint_vel=1.0))
    assert all(torch.equal(value, copy) for value, copy in zip(start, kept, strict=True))
