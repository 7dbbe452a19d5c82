"""Sigmas that follow the tracking error: by hand, and in an environment."""

import math

import pytest
import torch

from tlr_exp import keys
from tlr_exp.env.temperatures import Temperatures

CPU = torch.device("cpu")


def value(error: float, sigma: float) -> float:
    return math.exp(-error / sigma)


def test_sigma_shrinks_to_the_average_error_and_never_grows():
    made = Temperatures({"a": 0.4, "b": 1.0}, rate=0.5, device=CPU)
    # Mean errors 0.2 and 3.0: averages (0.4 + 0.2) / 2 and (1 + 3) / 2.
    made.update(
        torch.tensor([[value(0.1, 0.4), value(2.0, 1.0)], [value(0.3, 0.4), value(4.0, 1.0)]])
    )
    assert made.error.tolist() == pytest.approx([0.3, 2.0])
    assert made.sigma.tolist() == pytest.approx([0.3, 1.0])
    # Errors 0.7 and 0, told by the first sigmas: averages 0.5 and 1.
    made.update(torch.tensor([[value(0.7, 0.4), value(0.0, 1.0)]]))
    assert made.error.tolist() == pytest.approx([0.5, 1.0])
    assert made.sigma.tolist() == pytest.approx([0.3, 1.0])


def test_an_error_so_large_that_its_term_is_0_leaves_sigma_alone():
    made = Temperatures({"a": 0.01}, rate=0.5, device=CPU)
    made.update(torch.zeros(3, 1))
    assert made.error.isfinite().all()
    assert made.sigma.tolist() == pytest.approx([0.01])


def test_an_error_that_stays_is_what_sigma_ends_at():
    made = Temperatures({"a": 1.0}, rate=0.1, device=CPU)
    for _ in range(200):
        made.update(torch.tensor([[value(0.2, 1.0)]]))
    assert made.sigma.item() == pytest.approx(0.2, rel=1e-3)


def test_a_few_robots_that_are_far_off_keep_the_mean_error_above_sigma():
    made = Temperatures({"a": 0.03}, rate=0.01, device=CPU)
    # One in a hundred at 2.0, the others at 0.001: a mean of 0.021, however small sigma becomes.
    errors = [2.0] + [0.001] * 99
    for _ in range(2000):
        made.update(torch.tensor([[value(error, 0.03)] for error in errors]))
    assert made.sigma.item() == pytest.approx(sum(errors) / 100, rel=1e-3)


def rolled_out(env, num_steps: int) -> torch.Tensor:
    now, terms = env.reset(), []
    for _ in range(num_steps):
        stepped, now = env.step_and_maybe_reset(now.set(keys.ACTION, torch.zeros(4, 23)))
        terms.append(stepped["next", keys.REWARD_TERMS])
    return torch.stack(terms)


def test_an_environment_computes_its_goal_terms_with_the_sigmas_of_now(make_env):
    fixed, adaptive = make_env(), make_env(sigma_rate=0.1)
    plain, sharp = rolled_out(fixed, 30), rolled_out(adaptive, 30)
    assert fixed.recorded.sigmas() == {}
    goal = [adaptive.term_names.index(name) for name in adaptive.recorded.sigmas()]
    assert len(goal) == 4
    torch.testing.assert_close(sharp[0], plain[0])  # before anything has been averaged
    costs = [column for column in range(plain.shape[-1]) if column not in goal]
    assert torch.equal(sharp[..., costs], plain[..., costs])
    # A smaller sigma is a smaller term at the same error.
    assert (sharp[..., goal] <= plain[..., goal] + 1e-6).all()
    first = {"body_pos": 0.03, "body_rot": 1.0, "body_vel": 1.0, "body_ang_vel": 10.0}
    now = adaptive.recorded.sigmas()
    assert all(now[name] <= sigma * (1 + 1e-6) for name, sigma in first.items())
    assert now["body_rot"] < 1.0
