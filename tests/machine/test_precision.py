"""The precision of the networks: what ``auto`` means, and what a lower one changes."""

import pytest
import torch
from learners import ONE_PASS, collected, parameters_of, ready, same
from tensordict import TensorDictBase

from tlr_exp import keys
from tlr_exp.machine.precision import chosen_precision
from tlr_exp.ppo.learner import Ppo
from tlr_exp.ppo.networks import in_float32, set_precision


@pytest.mark.parametrize(
    ("features", "expected"),
    [
        ({}, "float32"),
        ({"avx512_bf16": False, "amx_bf16": False, "avx2": True}, "float32"),
        ({"avx512_bf16": True}, "bfloat16"),
        ({"amx_bf16": True}, "bfloat16"),
    ],
)
def test_auto_is_what_the_processor_is_fast_at(monkeypatch, features, expected):
    monkeypatch.setattr(torch.cpu, "get_capabilities", lambda: features)
    assert chosen_precision("auto", "cpu") == expected
    assert chosen_precision("auto", "cuda:0") == "float32"


@pytest.mark.parametrize("asked", ["float32", "bfloat16"])
def test_what_is_asked_for_is_done_on_any_processor(monkeypatch, asked):
    monkeypatch.setattr(torch.cpu, "get_capabilities", dict)
    assert chosen_precision(asked, "cpu") == asked


@pytest.fixture
def make_lower(make_ppo):
    """``make_lower(*overrides)``: a learner in bfloat16."""

    def make(*overrides: str) -> Ppo:
        ppo = make_ppo(*overrides)
        for network in (ppo.actor, ppo.critic):
            set_precision(network, "bfloat16")
        return ppo

    return make


def means(ppo: Ppo, batch: TensorDictBase) -> torch.Tensor:
    with torch.no_grad():
        return ppo.actor(batch.select(keys.OBSERVATION))["loc"]


def test_bfloat16_is_near_float32_and_all_that_is_kept_is_float32(make_lower, make_ppo):
    lower = make_lower()
    batch = collected(lower)
    rounded, exact = means(lower, batch), means(make_ppo(), batch)
    # bfloat16 has 8 binary digits; four layers each add an error of this order.
    assert 0.0 < (rounded - exact).abs().max() < 4 * 2.0**-8 * exact.abs().max()
    lower.estimate_advantages(batch)
    lower.update(batch)
    assert {value.dtype for value in batch.values(True, True)} == {torch.float32, torch.bool}
    assert {p.dtype for p in (*lower.actor_parameters, *lower.critic_parameters)} == {torch.float32}


def test_the_policy_that_collected_in_bfloat16_has_no_divergence_from_itself(make_lower):
    lower = make_lower(*ONE_PASS)
    batch = ready(lower)
    diagnostics = lower.update(batch)
    assert diagnostics.kl == pytest.approx(0.0, abs=1e-6)
    assert diagnostics.clip_fraction == 0.0


def test_the_same_seed_learns_the_same_bits_in_bfloat16(make_lower):
    def learned():
        ppo = make_lower()
        ppo.update(ready(ppo))
        return parameters_of(ppo)

    assert same(learned(), learned())


def test_policies_are_judged_in_float32_and_go_on_in_their_own_precision(make_lower, make_ppo):
    lower = make_lower()
    batch = collected(lower)
    rounded, exact = means(lower, batch), means(make_ppo(), batch)
    with in_float32(lower.actor):
        assert torch.equal(means(lower, batch), exact)
    assert torch.equal(means(lower, batch), rounded)
