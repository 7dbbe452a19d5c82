"""A policy rolled out in the real environment, and measured."""

import numpy as np
import pytest
import torch
from tensordict import TensorDict

from tlr_exp import keys
from tlr_exp.env.observations import observation_dims
from tlr_exp.evaluation.latency import latency
from tlr_exp.evaluation.result import evaluate_trajectory
from tlr_exp.evaluation.rollout import rollout
from tlr_exp.motion.clip import clip_from_qpos
from tlr_exp.ppo.networks import build_actor
from tlr_exp.reward.split import RewardSplit
from tlr_exp.robot.g1 import G1

DT = 0.02
SPLIT = RewardSplit({"body_pos": 1.0}, {}, DT, ["body_pos"])


def still_policy(tensordict):
    action = torch.zeros(*tensordict.batch_size, G1.num_joints)
    return tensordict.set(keys.ACTION, action)


def evaluation_env(make_env, frames=(0,), **arguments):
    zero = "env.start_phase=zero"
    return make_env(zero, failures=False, num_envs=len(frames), start_frames=frames, **arguments)


def test_rollout_follows_the_motion_to_its_end(make_env, short_clip, settings_of):
    env = evaluation_env(make_env)
    names = tuple(settings_of().reward.goal) + tuple(settings_of().reward.optimizing)
    (trajectory,) = rollout(env, still_policy)
    lead = env.settings.reference_lead
    assert trajectory.num_steps == short_clip.num_frames - 1 - lead
    # Row k is after step k + 1, with the reference of that instant read `lead` steps ahead.
    np.testing.assert_allclose(trajectory.reference_qpos, short_clip.qpos[1 + lead :], atol=1e-6)
    np.testing.assert_allclose(
        trajectory.reference_body_pos_w, short_clip.body_pos_w[1 + lead :], atol=1e-6
    )
    assert set(trajectory.terms) == set(names)
    assert not trajectory.unstable.any()
    # The last step is the one at which the environment itself calls the motion over.
    env.reset()
    ends = [
        bool(env.step(still_policy(TensorDict({}, batch_size=[1])))["next", keys.TRUNCATED])
        for _ in range(trajectory.num_steps)
    ]
    assert ends == [False] * (trajectory.num_steps - 1) + [True]


def test_measures_agree_with_what_the_environment_reports(make_env, settings_of):
    env = evaluation_env(make_env)
    names = tuple(settings_of().reward.goal) + tuple(settings_of().reward.optimizing)
    (trajectory,) = rollout(env, still_policy)
    result = evaluate_trajectory(trajectory, 0.8, 0.3, SPLIT)
    now = env.reset()
    reported = {key: [] for key in (keys.UPPER_BODY_ERROR, keys.LOWER_BODY_ERROR, keys.JOINT_ERROR)}
    terms = []
    for _ in range(result.num_steps):
        after = env.step(still_policy(now))["next"]
        for key, values in reported.items():
            values.append(float(after[key]))
        terms.append(after[keys.REWARD_TERMS][0].numpy())
    upper, lower, joint = (np.mean(values) for values in reported.values())
    assert result.upper_body_error_m == pytest.approx(upper, rel=1e-5)
    assert result.lower_body_error_m == pytest.approx(lower, rel=1e-5)
    assert result.joint_error_rad == pytest.approx(joint, rel=1e-5)
    assert result.terms == pytest.approx(
        dict(zip(names, np.mean(terms, axis=0), strict=True)), rel=1e-5, abs=1e-9
    )


def test_rollout_can_be_cut_short_and_refuses_what_ends_early(make_env, settings_of):
    (trajectory,) = rollout(evaluation_env(make_env), still_policy, num_steps=3)
    assert trajectory.num_steps == 3
    with pytest.raises(ValueError, match="failures=False"):
        rollout(make_env(num_envs=1), still_policy)


def test_rollout_uses_the_mean_action_and_no_random_number(make_env, settings_of):
    settings_ = settings_of("ppo.hidden_sizes=[8]", "ppo.initial_std=1.0")
    actor = build_actor(
        observation_dims(G1)["history"],
        G1.num_joints,
        settings_.ppo,
        torch.Generator().manual_seed(0),
    )
    before = torch.get_rng_state()
    runs = [*(rollout(evaluation_env(make_env), actor, num_steps=5)[0] for _ in range(2))]
    np.testing.assert_array_equal(runs[0].qpos, runs[1].qpos)
    assert torch.equal(torch.get_rng_state(), before)


def arrays_of(trajectory):
    names = ("qpos", "reference_qpos", "body_pos_w", "reference_body_pos_w", "unstable")
    return {name: getattr(trajectory, name) for name in names} | trajectory.terms


def test_robots_of_a_batch_do_what_each_does_alone(make_env, settings_of):
    """To the bit with a policy without matrix products, whose rounding may know the batch."""
    frames = (0, 30, 11)

    def policy(tensordict):
        return tensordict.set(keys.ACTION, 0.3 * torch.sin(tensordict[keys.OBSERVATION][:, :23]))

    together = rollout(evaluation_env(make_env, frames), policy)
    assert [trajectory.num_steps for trajectory in together] == [39, 9, 28]
    for frame, in_batch in zip(frames, together, strict=True):
        (alone,) = rollout(evaluation_env(make_env, (frame,)), policy)
        for name, values in arrays_of(alone).items():
            np.testing.assert_array_equal(arrays_of(in_batch)[name], values, err_msg=name)


def test_a_network_s_batch_differs_from_single_roll_outs_by_rounding_alone(make_env, settings_of):
    settings_ = settings_of("ppo.hidden_sizes=[64,64]")
    generator = torch.Generator().manual_seed(0)
    dim = observation_dims(G1)["history"]
    actor = build_actor(dim, G1.num_joints, settings_.ppo, generator)
    frames = tuple(range(0, 32, 2))
    together = rollout(evaluation_env(make_env, frames), actor)
    for frame, in_batch in zip(frames, together, strict=True):
        (alone,) = rollout(evaluation_env(make_env, (frame,)), actor)
        # Rounding of 1e-7 a step, which contacts amplify; a robot at another's frame is off by cm.
        np.testing.assert_allclose(in_batch.qpos, alone.qpos, rtol=0, atol=1e-3)
        np.testing.assert_allclose(in_batch.body_pos_w, alone.body_pos_w, rtol=0, atol=1e-3)


@pytest.mark.parametrize("frames", [(0,), (0, 39), (-1, 0)])
def test_start_frames_that_do_not_fit_are_refused(make_env, frames):
    with pytest.raises(ValueError, match=r"needed are 2, one for each robot, from 0 to 38"):
        make_env(num_envs=2, start_frames=frames)


def test_a_motion_that_is_driven_late_is_found_late_by_as_much(make_env, robot):
    """A policy that aims at the reference as it was six steps ago, and one that is on time."""
    time_s = np.arange(151) * DT
    qpos = np.zeros((151, 30))
    qpos[:, 2], qpos[:, 3] = 0.76, 1.0
    qpos[:, 7:] = robot.default_joint_pos_rad
    for joint, speed in (("left_shoulder_roll", 3.0), ("right_elbow", 4.3)):
        index = 7 + G1.joint_names.index(f"{joint}_joint")
        qpos[:, index] += 0.4 * (1 - np.cos(speed * time_s))
    clip = clip_from_qpos(qpos, 1 / DT, robot)

    def delay_of(steps_late: int) -> float:
        env = evaluation_env(make_env, clip=clip)

        def policy(tensordict):
            frame = env.episode_step + env.settings.reference_lead - steps_late
            target = env.reference.frame(frame).qpos[:, 7:]
            action = (target - env.joint_targets.default_pos) / env.joint_targets.scale
            return tensordict.set(keys.ACTION, action)

        (trajectory,) = rollout(env, policy)
        found = latency(trajectory.reference_qpos[:, 7:], trajectory.qpos[:, 7:], DT)
        assert found.ms is not None, found.reason
        return found.ms

    on_time, late = delay_of(0), delay_of(6)
    assert 0.0 < on_time < 150.0
    assert late - on_time == pytest.approx(120.0, abs=15.0)
