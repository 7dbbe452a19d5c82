"""Simulations that go wrong: ended, flagged, kept for inspection, and started anew."""

import pytest
import torch
from tensordict import TensorDictBase

from tlr_exp import keys

NUM_ENVS = 4
BAD = 2
OTHERS = torch.tensor([0, 1, 3])


def actions(num_steps: int) -> torch.Tensor:
    generator = torch.Generator().manual_seed(0)
    return 0.3 * torch.randn(num_steps, NUM_ENVS, 23, generator=generator)


def advance(
    env, now: TensorDictBase, action: torch.Tensor
) -> tuple[TensorDictBase, TensorDictBase]:
    stepped, now = env.step_and_maybe_reset(now.set(keys.ACTION, action))
    return stepped["next"], now


def poison(env, field: str, value: float) -> None:
    """Make the engine's own state of one robot wrong; the environment has not seen it yet."""
    getattr(env.physics, field)[BAD, 12] = value


def assert_finite(outputs: TensorDictBase) -> None:
    for key, value in outputs.items(True, True):
        assert value.isfinite().all(), key


@pytest.mark.parametrize("observation", ["history", "reference"])
@pytest.mark.parametrize(
    ("field", "value"),
    # 1e3 rad/s passes through 1e12 rad/s, still finite, on its way to NaN.
    [("_qpos", torch.nan), ("_qvel", torch.inf), ("_qvel", 1e30), ("_qvel", 1e3)],
)
@pytest.mark.filterwarnings("ignore:MuJoCo:RuntimeWarning")
def test_unstable_environment_is_ended_flagged_and_revived(make_env, observation, field, value):
    env = make_env(f"env.observation={observation}", "env.start_phase=zero")
    healthy = make_env(f"env.observation={observation}", "env.start_phase=zero")
    now, expected_now = env.reset(), healthy.reset()
    script = actions(12)
    for action in script[:3]:
        advance(healthy, expected_now, action)
        _, now = advance(env, now, action)
    before = env.state
    poison(env, field, value)

    after, now = advance(env, now, script[3])
    assert after[keys.UNSTABLE].squeeze(-1).tolist() == [k == BAD for k in range(NUM_ENVS)]
    assert after[keys.TERMINATED][BAD]
    assert not after[keys.TRUNCATED][BAD]
    assert after[keys.DONE][BAD]
    assert_finite(after)
    assert_finite(now)
    expected, _ = advance(healthy, expected_now, script[3])
    for key in after.keys(True, True):
        assert torch.equal(after[key][OTHERS], expected[key][OTHERS]), key
    # The new episode is one like any other.
    assert env.episode_step[BAD] == 0
    for action in script[4:]:
        after, now = advance(env, now, action)
        assert not after[keys.UNSTABLE].any()
        assert_finite(after)

    taken = env.take_unstable_states()
    assert torch.equal(taken["qpos"], before.qpos[BAD : BAD + 1])
    assert torch.equal(taken["qvel"], before.qvel[BAD : BAD + 1])
    assert torch.equal(taken["action"], script[3, BAD : BAD + 1])
    assert all(value.numel() == 0 for value in env.take_unstable_states().values())


def test_unstable_states_of_several_steps_are_kept_together(make_env):
    env = make_env()
    now = env.reset()
    for action in actions(3):
        poison(env, "_qpos", torch.nan)
        _, now = advance(env, now, action)
    taken = env.take_unstable_states()
    assert taken["qpos"].shape == (3, 30)
    assert taken["qvel"].shape == (3, 29)
    assert torch.equal(taken["action"], actions(3)[:, BAD])


def test_no_unstable_state_nothing_to_take(make_env):
    env = make_env()
    env.reset()
    assert set(env.take_unstable_states()) == {"qpos", "qvel", "action"}


def test_an_evaluation_ends_an_unstable_episode_and_reports_finite_figures(make_env):
    env = make_env(failures=False)
    now = env.reset()
    poison(env, "_qpos", torch.nan)
    for action in actions(4):  # nobody resets it
        after = env.step(now.set(keys.ACTION, action))["next"]
        assert after[keys.UNSTABLE].squeeze(-1).tolist() == [False, False, True, False]
        assert after[keys.TERMINATED][BAD]
        assert_finite(after)


@pytest.mark.filterwarnings("ignore:MuJoCo:RuntimeWarning")
def test_outputs_stay_finite_however_a_simulation_diverges(make_env):
    """Targets of hundreds of radians make robots fly apart, through any speed there is."""
    env = make_env(num_envs=64)
    now = env.reset()
    generator = torch.Generator().manual_seed(0)
    unstable = 0
    for _ in range(50):
        after, now = advance(env, now, 300.0 * torch.randn(64, 23, generator=generator))
        assert_finite(after)
        assert env.state.qvel.abs().max() < 1e3
        unstable += after[keys.UNSTABLE].sum().item()
    assert unstable > 0
    assert len(env.take_unstable_states()["qpos"]) == unstable
