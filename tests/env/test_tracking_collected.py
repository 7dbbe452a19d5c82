"""The environment behind TorchRL's collector, and its steps with resets."""

import torch
from tensordict import TensorDictBase
from tensordict.nn import TensorDictModule
from torchrl.collectors import Collector
from torchrl.envs import EnvBase
from torchrl.envs.utils import check_env_specs

from tlr_exp import keys
from tlr_exp.env.instant import Instant
from tlr_exp.env.terms import TERMS
from tlr_exp.env.transition import Transition
from tlr_exp.motion.reference import Reference
from tlr_exp.robot.g1 import G1
from tlr_exp.training.build import build_collect

NUM_ENVS = 4


def test_collected_terms_are_the_pure_functions_of_what_happened(
    make_env, settings_of, short_clip, monkeypatch
):
    """Over a reset, and with nothing that the environment keeps overwritten by the collector."""
    env = make_env("env.start_phase=zero", failures=False)
    states = []
    step = env.physics.step
    monkeypatch.setattr(
        env.physics, "step", lambda target: states.append(step(target)) or states[-1]
    )
    noise = torch.Generator().manual_seed(0)

    def policy(now: TensorDictBase) -> TensorDictBase:
        return now.set(keys.ACTION, torch.randn(NUM_ENVS, 23, generator=noise))

    collector = Collector(
        env,
        policy,
        frames_per_batch=NUM_ENVS * 15,
        total_frames=-1,
        track_traj_ids=False,
        auto_register_policy_transforms=False,
    )
    batches = iter(collector)
    batch = torch.cat([next(batches).clone() for _ in range(3)], dim=1)
    collector.shutdown()

    reference, parameters = Reference(short_clip), settings_of().reward.parameters
    names = (*settings_of().reward.goal, *settings_of().reward.optimizing)
    previous = torch.zeros(NUM_ENVS, 23)
    for k, state in enumerate(states):
        elapsed = k % 39 + 1  # 39 steps lead from frame 0 to the last but one
        action, after = batch[keys.ACTION][:, k], batch["next"][:, k]
        transition = Transition(
            Instant(state, reference.frame(torch.full((NUM_ENVS,), elapsed + 1)), G1),
            action,
            previous,
            torch.zeros(NUM_ENVS, dtype=torch.bool),
            env.limits,
        )
        assert after[keys.REWARD_TERMS].shape == (NUM_ENVS, len(names))
        for column, name in enumerate(names):
            expected = TERMS[name](transition, **parameters.get(name, {}))
            torch.testing.assert_close(after[keys.REWARD_TERMS][:, column], expected)
        assert after[keys.TRUNCATED].all() if elapsed == 39 else not after[keys.DONE].any()
        previous = torch.zeros(NUM_ENVS, 23) if elapsed == 39 else action
    assert len(states) == 45


def test_what_is_added_to_a_batch_does_not_reach_the_next(make_env):
    env = make_env("env.start_phase=zero")
    policy = TensorDictModule(
        lambda seen: 0.1 * seen[:, :23], in_keys=[keys.OBSERVATION], out_keys=[keys.ACTION]
    )
    collect = build_collect(env, policy, num_steps=3)
    first = collect()
    first["next", keys.REWARD] = torch.zeros(NUM_ENVS, 3, 1)
    second = collect()
    assert second.shape == (NUM_ENVS, 3)
    assert keys.REWARD not in set(second["next"].keys())
    # The batches follow one another: the last state of the first was the start of the second.
    assert torch.equal(env.observed, second["next", keys.OBSERVATION][:, -1])


def test_stepping_with_resets_gives_what_torchrl_gives_to_the_bit(make_env):
    ours, generic = (make_env("env.termination.distance_start_m=0.35") for _ in range(2))
    now, other = ours.reset(), generic.reset()
    generator = torch.Generator().manual_seed(1)
    resets = 0
    for _ in range(60):
        action = torch.randn(ours.action_spec.shape, generator=generator)
        stepped, now = ours.step_and_maybe_reset(now.set(keys.ACTION, action))
        expected, other = EnvBase.step_and_maybe_reset(generic, other.set(keys.ACTION, action))
        assert (stepped == expected).all()
        assert set(now.keys()) == set(other.keys())
        # TorchRL zeroes the old actions of those that restart; the next step overwrites them.
        for key in set(now.keys()) - {keys.ACTION}:
            assert torch.equal(now.get(key), other.get(key)), key
        resets += int(stepped["next", keys.DONE].sum())
    assert resets > 4


def test_costs_of_the_state_are_shown_where_a_step_begins_across_resets(make_env):
    """As potentials need them: at the end of the motion not those of the next start."""
    names = ["lin_vel_z", "base_height"]
    env = make_env("env.start_phase=zero", potentials=names, failures=False)
    check_env_specs(env)
    policy = TensorDictModule(
        lambda seen: 0.1 * seen[:, :23], in_keys=[keys.OBSERVATION], out_keys=[keys.ACTION]
    )
    batch = build_collect(env, policy, num_steps=45)()
    before = batch[keys.STATE_COSTS]
    after = batch["next", keys.REWARD_TERMS][..., [env.term_names.index(name) for name in names]]
    assert torch.equal(batch["next", keys.STATE_COSTS], after)
    ends = batch["next", keys.DONE].squeeze(-1)[0].nonzero().flatten().tolist()
    assert ends == [38]  # 39 steps lead from frame 0 to the last but one
    goes_on = [step for step in range(44) if step not in ends]
    assert torch.equal(before[:, [step + 1 for step in goes_on]], after[:, goes_on])
    # Every episode starts in the same state, and not in that in which the last one ended.
    assert torch.equal(before[:, 39], before[:, 0])
    assert not torch.equal(before[:, 39], after[:, 38])
    heights = env.reference.frame(torch.tensor([0, 1])).qpos[:, 2]
    torch.testing.assert_close(before[0, 0, 1], (heights[0] - heights[1]).square())
