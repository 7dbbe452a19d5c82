"""A saved simulation goes on bit for bit in a fresh environment."""

import io

import pytest
import torch
from tensordict import TensorDictBase

from tlr_exp import keys

NUM_ENVS = 4
NOISE = ("env.reset_noise.joint_pos_rad=0.05", "env.reset_noise.root_rot_rad=0.05")


def actions(num_steps: int, seed: int) -> torch.Tensor:
    generator = torch.Generator().manual_seed(seed)
    return 0.5 * torch.randn(num_steps, NUM_ENVS, 23, generator=generator)


def run(env, now: TensorDictBase, script: torch.Tensor) -> tuple[TensorDictBase, TensorDictBase]:
    """Step through a script with resets; returns the transitions and the next start."""
    steps = []
    for action in script:
        step, now = env.step_and_maybe_reset(now.set(keys.ACTION, action))
        steps.append(step)
    return torch.stack(steps, dim=1), now


def through_a_file(saved: dict) -> dict:
    buffer = io.BytesIO()
    torch.save(saved, buffer)
    buffer.seek(0)
    return torch.load(buffer, weights_only=True)


def assert_same_bits(left: TensorDictBase, right: TensorDictBase) -> None:
    assert set(left.keys(True, True)) == set(right.keys(True, True))
    for key in left.keys(True, True):
        assert torch.equal(left[key], right[key]), key


@pytest.fixture
def make(make_env):
    def build(*overrides: str, **arguments):
        # The limit tightens as episodes end, so that it too must be restored.
        return make_env(
            *NOISE,
            "env.termination.tighten_above_steps=5",
            "env.termination.loosen_below_steps=1",
            *overrides,
            "env.termination.tighten_rate=0.01",
            **arguments,
        )

    return build


@pytest.mark.parametrize(
    "choice",
    ["env.observation=history", "env.observation=reference", "env.start_phase=adaptive"],
)
@pytest.mark.parametrize("steps_before", [0, 60])
def test_fresh_environment_continues_bit_for_bit(make, choice, steps_before):
    env = make(choice)
    now = env.reset()
    if steps_before:
        _, now = run(env, now, actions(steps_before, seed=1))
        assert env.distance.value_m < 1.45
    saved = through_a_file(env.simulation_state())
    script = actions(30, seed=2)
    expected, _ = run(env, now, script)
    # Episodes end and start within the thirty steps, so generator and limit matter.
    assert expected["next", keys.DONE].any()

    fresh = make(choice, seed=99, saved=saved)
    start = fresh.reset()
    for key in (keys.OBSERVATION, keys.PRIVILEGED):
        assert torch.equal(start[key], now[key])
    found, _ = run(fresh, start, script)
    assert_same_bits(found["next"], expected["next"])
    assert torch.equal(found[keys.OBSERVATION], expected[keys.OBSERVATION])
    assert torch.equal(fresh.distance.value_m, env.distance.value_m)
    assert fresh.distance.value_m < 1.5


def test_only_the_first_full_reset_hands_back_the_saved_episodes(make):
    env = make()
    run(env, env.reset(), actions(5, seed=1))
    before = env.episode_step
    assert before.any()
    fresh = make(saved=env.simulation_state())
    fresh.reset()
    assert torch.equal(fresh.episode_step, before)
    fresh.reset()
    assert not fresh.episode_step.any()


def test_a_partial_reset_after_a_restoration_starts_those_episodes(make):
    env = make("env.start_phase=zero")
    _, now = run(env, env.reset(), actions(5, seed=1))
    fresh = make("env.start_phase=zero", saved=env.simulation_state())
    mask = torch.tensor([True, False, False, False])[:, None]
    fresh.reset(now.set("_reset", mask))
    assert fresh.episode_step.tolist() == [0, 5, 5, 5]


def test_an_environment_that_steps_on_after_a_restoration_can_be_reset(make):
    env = make("env.start_phase=zero")
    _, now = run(env, env.reset(), actions(5, seed=1))
    fresh = make("env.start_phase=zero", saved=env.simulation_state())
    run(fresh, now, actions(1, seed=2))
    assert fresh.episode_step.tolist() == [6] * NUM_ENVS
    fresh.reset()
    assert fresh.episode_step.tolist() == [0] * NUM_ENVS


def test_a_saved_state_is_not_changed_by_going_on(make):
    env = make()
    _, now = run(env, env.reset(), actions(3, seed=1))
    saved = env.simulation_state()
    kept = through_a_file(saved)
    run(env, now, actions(30, seed=2))
    for part in ("physics", "distance", "buffers"):
        for name, value in kept[part].items():
            assert torch.equal(saved[part][name], value), name
    assert torch.equal(saved["generator"], kept["generator"])


def test_a_checkpoint_without_start_phases_is_restored(make):
    """Those of earlier versions."""
    env = make()
    run(env, env.reset(), actions(5, seed=1))
    saved = through_a_file(env.simulation_state())
    del saved["starts"]
    fresh = make(seed=9, saved=saved)
    assert torch.equal(fresh.episode_step, env.episode_step)
    script = actions(30, seed=2)
    expected, _ = run(env, env._reset_output(), script)
    found, _ = run(fresh, fresh.reset(), script)
    assert_same_bits(found["next"], expected["next"])
