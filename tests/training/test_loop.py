"""What surrounds an iteration: stability, checkpoints, evaluation; in this process."""

import numpy as np
import pytest
import torch
from learners import build_training

from tlr_exp import keys
from tlr_exp.assembly.split import build_split
from tlr_exp.assembly.terms import terms_of_training
from tlr_exp.errors import UserError
from tlr_exp.evaluation.result import evaluate_policy
from tlr_exp.ppo.networks import in_float32
from tlr_exp.records.checkpoint_files import read_scores
from tlr_exp.records.extending import extend
from tlr_exp.records.run_directory import RunDirectory
from tlr_exp.training.loop import (
    SNAPSHOT_SHARES,
    UnstableSimulationError,
    checkpoint_store,
)

TINY = (
    "scale.num_envs=16",
    "scale.iterations=3",
    "scale.evaluate_every=3",
    "ppo.num_steps=4",
    "ppo.hidden_sizes=[16]",
    "num_threads=1",
    "physics.num_threads=1",
)


@pytest.fixture
def training(tmp_path, settings_of, short_clip_path):
    settings = settings_of(*TINY, f"env.motion={short_clip_path}")
    run = RunDirectory.create(tmp_path / "run", {"seed": 0}, {})
    return build_training(settings, run)


def poison(physics, env_ids, monkeypatch):
    """From the next step on, ``env_ids`` come back as NaN, once."""
    step = physics.step

    def poisoned(target):
        state = step(target)
        monkeypatch.setattr(physics, "step", step)
        state.qpos[env_ids] = torch.nan
        return state

    monkeypatch.setattr(physics, "step", poisoned)


def test_one_per_cent_of_unstable_simulations_stops_the_run(training, monkeypatch):
    # 1 of 16 is above 1 %.
    poison(training.env.physics, [3], monkeypatch)
    with pytest.raises(UnstableSimulationError, match="in iteration 1 1 of 16") as error:
        training.train()
    with np.load(training.run.path / "unstable_iteration_1.npz") as file:
        saved = dict(file)
    assert str(training.run.path) in str(error.value)
    assert saved["qpos"].shape == (1, 30)
    assert saved["action"].shape == (1, 23)
    assert all(np.isfinite(saved[name]).all() for name in ("qpos", "qvel", "action"))


def test_a_smaller_share_is_counted_and_the_run_goes_on(
    tmp_path, settings_of, short_clip_path, monkeypatch
):
    settings = settings_of(*TINY, "scale.num_envs=128", f"env.motion={short_clip_path}")
    run = RunDirectory.create(tmp_path / "run", {"seed": 0}, {})
    training = build_training(settings, run)
    poison(training.env.physics, [7], monkeypatch)
    assert training.train().status == "finished"
    assert [line[keys.UNSTABLE_ENVS] for line in run.metrics()] == [1, 0, 0]
    assert all(np.isfinite(line[keys.STEP_REWARD]) for line in run.metrics())


def test_returns_that_are_not_finite_end_the_run_with_an_explanation(tmp_path, settings_of):
    huge = "reward.optimizing.ang_vel_xy=-3e38"  # times what float32 holds
    run = RunDirectory.create(tmp_path / "run", {"seed": 0}, {})
    with pytest.raises(UserError, match="term_returns is not finite"):
        build_training(settings_of(*TINY, huge, "optimizer=gwo"), run).train()


def test_damaged_metrics_end_a_resume_with_an_explanation(training):
    training.run.metrics_path.write_text("no metrics\n" * 2)
    with pytest.raises(UserError, match=r"metrics\.jsonl"):
        training.train()


def test_snapshots_of_the_papers_figures_are_kept(settings_of, tmp_path):
    run = RunDirectory.create(tmp_path / "run", {"seed": 0}, {})
    store = checkpoint_store(settings_of("scale=paper"), run)
    # Figures 9-12 show iterations 100, 500, 1000 and 2200 of 2500.
    assert store.keep_iterations == {100, 500, 1000, 2200}
    assert len(SNAPSHOT_SHARES) == 4


def test_an_extended_run_keeps_what_the_shorter_one_kept(settings_of, tmp_path):
    run = RunDirectory.create(tmp_path / "run", {"scale": {"iterations": 2500}}, {})
    extend(run, 5000, done=2500, identity="")
    store = checkpoint_store(settings_of("scale=paper", "scale.iterations=5000"), run)
    assert store.keep_iterations == {100, 500, 1000, 2200, 2500} | {200, 1000, 2000, 4400}


def test_the_last_iteration_is_evaluated_and_kept_as_best(training):
    assert training.train().iteration == 3
    last = training.run.metrics()[-1]
    error = 0.5 * (last["eval/upper_body_error_m"] + last["eval/lower_body_error_m"])
    assert error > 0
    assert training.store.best() == training.store.path_of(3)


def evaluated(tmp_path, settings_of, starts):
    settings = settings_of(*TINY, "scale.iterations=1", f"scale.evaluate_starts={starts}")
    training = build_training(
        settings, RunDirectory.create(tmp_path / f"{starts}", {"seed": 0}, {})
    )
    training.train()
    return training, training.run.metrics()[-1]


def test_an_evaluation_is_the_mean_over_its_start_phases(tmp_path, settings_of):
    training, metrics = evaluated(tmp_path, settings_of, 4)
    env, actor = training.evaluation_env, training.trainer.ppo.actor
    assert env.start_frame.tolist() == [0, 9, 19, 29]  # of 39 control steps
    with in_float32(actor):
        each = [result for _, result in evaluate_policy(env, actor, training.judged_split)]
    errors = [(one.upper_body_error_m, one.lower_body_error_m) for one in each]
    assert len(set(errors)) == 4
    upper, lower = np.mean(errors, axis=0)
    assert metrics["eval/upper_body_error_m"] == pytest.approx(upper)
    assert metrics["eval/survival"] == pytest.approx(np.mean([one.survival for one in each]))
    assert metrics[keys.EVAL_SUCCESS] == np.mean([one.survival == 1.0 for one in each])
    score = read_scores(training.store.path_of(1).parent)[1]
    assert score == pytest.approx(-(upper + lower) / 2)


def test_an_evaluation_of_one_start_has_the_metrics_of_earlier_runs(tmp_path, settings_of):
    training, metrics = evaluated(tmp_path, settings_of, 1)
    env, actor = training.evaluation_env, training.trainer.ppo.actor
    with in_float32(actor):
        ((_, result),) = evaluate_policy(env, actor, training.judged_split)
    expected = {name: value for name, value in result.metrics().items() if value == value}
    found = {name: value for name, value in metrics.items() if name.startswith(keys.EVAL_PREFIX)}
    assert {name: value for name, value in found.items() if value == value} == expected
    assert found.keys() == result.metrics().keys()


def test_one_seed_gives_the_same_bits_twice_and_another_seed_others(
    tmp_path, settings_of, short_clip_path
):
    def trained(name, seed):
        settings = settings_of(*TINY, f"env.motion={short_clip_path}", f"seed={seed}")
        run = RunDirectory.create(tmp_path / name, {"seed": seed}, {})
        training = build_training(settings, run)
        training.train()
        lines = [{k: v for k, v in m.items() if "time" not in k} for m in run.metrics()]
        return repr(lines), training.trainer.ppo.actor.state_dict()

    first, second, other = trained("a", 3), trained("b", 3), trained("c", 4)
    assert first[0] == second[0]
    assert all(torch.equal(first[1][name], second[1][name]) for name in first[1])
    assert first[0] != other[0]


@pytest.mark.gpu
@pytest.mark.parametrize("physics", ["native", "mjx"])
def test_a_training_on_cuda_resumes_from_its_checkpoint(
    tmp_path, settings_of, short_clip_path, physics
):
    if not torch.cuda.is_available():
        pytest.skip("no CUDA device here")
    changes = (f"env.motion={short_clip_path}", "device=cuda", f"physics={physics}")
    run = RunDirectory.create(tmp_path / "run", {"seed": 0}, {})
    first = build_training(settings_of(*TINY, *changes, "scale.iterations=2"), run)
    assert first.train().iteration == 2
    resumed = build_training(settings_of(*TINY, *changes), run)
    assert resumed.done == 2
    saved = first.trainer.ppo.actor.state_dict()
    restored = resumed.trainer.ppo.actor.state_dict()
    assert all(torch.equal(saved[name], restored[name]) for name in saved)
    assert resumed.train().iteration == 3
    assert np.isfinite(run.metrics()[-1][keys.STEP_REWARD])


def test_the_penalty_scale_multiplies_every_coefficient_of_the_lower_layer_alone(settings_of):
    plain, scaled = settings_of(), settings_of("reward.penalty_scale=0.25")
    names = tuple(terms_of_training(plain))
    terms = torch.ones(2, 3, len(names))
    none = torch.zeros(len(plain.reward.optimizing))
    ones = torch.ones_like(none)
    (goal, costs), (scaled_goal, scaled_costs) = (
        build_split(settings, names).returns(terms) for settings in (plain, scaled)
    )
    assert torch.equal(scaled_goal, goal)
    torch.testing.assert_close(scaled_costs, 0.25 * costs)
    goal_alone = build_split(plain, names).compose(terms, none)
    full = build_split(plain, names).compose(terms, ones) - goal_alone
    less = build_split(scaled, names).compose(terms, ones) - goal_alone
    torch.testing.assert_close(less, 0.25 * full)
