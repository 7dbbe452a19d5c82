"""From a command to checked jobs: presets, what wins, identities, mistakes."""

import re
from pathlib import Path

import pytest

from tlr_exp.config.load import ConfigError
from tlr_exp.sweeps import plan as planning
from tlr_exp.sweeps.plan import make_plan

CONF = Path(__file__).parents[2] / "conf"
MOTIONS = sorted(path.stem for path in (CONF / "env").glob("*.yaml"))
CONTROLS = ("fixed", "zero", "curriculum", "random", "random_search", "gwo")
OPTIMIZERS = (
    *("fixed", "gwo", "ospo", "pso", "differential_evolution", "cma_es", "random_search"),
    "effective_dimension",
)
RIVALS = (
    *("fixed", "zero", "random", "gwo", "curriculum", "when_tracking", "lagrangian", "gradnorm"),
    *("pcgrad", "meta_gradient"),
)
READINGS = (
    *("none", "episode", "per_step", "age_matched", "normalized", "smoothed", "under_curriculum"),
    *("when_tracking", "linear_limits", "asap_sigmas", "asap_distance", "fall_penalty"),
    *("linear_std", "asap_robot"),
)
OBJECTIVES = ("rank_deviation", "retained_share", "kendall", "spearman")
PENALTY_SCALES = ("0.01", "0.1", "0.3", "1", "3", "10")
SHARES = ("0.02", "0.05", "0.1", "0.2", "0.3", "0.5")


def seeds(count, arms, key="optimizer"):
    return [f"seed={seed} {key}={arm}" for seed in range(count) for arm in arms]


PRESETS = {
    "five_seeds": (seeds(5, ["fixed", "gwo"]), ("optimizer",)),
    "controls": (seeds(5, CONTROLS), ("optimizer",)),
    "rivals": (seeds(5, RIVALS), ("optimizer",)),
    "readings": ([f"reading={reading}" for reading in READINGS], ("reading",)),
    "which_optimizer": (seeds(3, OPTIMIZERS), ("optimizer",)),
    "which_objective": (seeds(3, OBJECTIVES, "reward/objective"), ("reward/objective",)),
    "penalty_scale": (
        [
            f"seed={seed} optimizer={arm} reward.penalty_scale={scale}"
            for seed in range(3)
            for arm in ("fixed", "gwo")
            for scale in PENALTY_SCALES
        ],
        ("optimizer", "reward.penalty_scale"),
    ),
    "threshold": (
        seeds(3, SHARES, "reward.objective.threshold_share"),
        ("reward.objective.threshold_share",),
    ),
    "pack_size": (
        seeds(3, ["5", "10", "30", "100"], "optimizer.pack_size"),
        ("optimizer.pack_size",),
    ),
    "tie_break": (
        seeds(5, ["first", "largest_norm"], "optimizer.tie_break"),
        ("optimizer.tie_break",),
    ),
}


@pytest.fixture
def trusting(monkeypatch):
    """Motions and models are not read: that takes seconds each, and has tests of its own."""
    monkeypatch.setattr(planning, "check_world", lambda settings, device: None)


def test_every_preset_is_tested_here():
    assert {path.stem for path in (CONF / "sweep").glob("*.yaml")} == {*PRESETS, "motions"}


@pytest.mark.usefixtures("trusting")
@pytest.mark.parametrize("name", PRESETS)
def test_presets_list_their_jobs_ask_a_question_and_set_nothing_else(name, multirun):
    plan = make_plan(multirun(f"+sweep={name}"))
    labels, arms = PRESETS[name]
    assert [job.label for job in plan.jobs] == labels
    assert plan.arms == arms
    assert plan.name == name
    assert re.match(r"\w.*\?", plan.description)
    # The configuration of a job is that of a single run with the same overrides.
    alone = make_plan(multirun(*plan.jobs[-1].overrides[:-1]))
    assert alone.jobs[0].identity == plan.jobs[-1].identity


@pytest.mark.usefixtures("trusting")
def test_motions_are_all_that_there_are(multirun):
    plan = make_plan(multirun("+sweep=motions", "seed=0"))
    swept = {o.partition("=")[2] for job in plan.jobs for o in job.overrides if o[:4] == "env="}
    assert sorted(swept) == MOTIONS
    assert len(plan.jobs) == 2 * len(MOTIONS)


@pytest.mark.usefixtures("trusting")
def test_what_stands_on_the_command_line_wins(multirun):
    plan = make_plan(multirun("+sweep=five_seeds", "seed=7,8", "optimizer=gwo", "scale=laptop"))
    assert [job.label for job in plan.jobs] == ["seed=7", "seed=8"]
    assert (plan.arms, plan.scale) == ((), "laptop")
    assert {job.method for job in plan.jobs} == {"gwo"}
    assert {job.iterations for job in plan.jobs} == {407}


@pytest.mark.usefixtures("trusting")
def test_the_same_command_is_the_same_sweep_however_it_is_run(multirun, tmp_path, monkeypatch):
    def sweep_id(*overrides):
        return make_plan(multirun("optimizer=fixed,gwo", *overrides)).sweep_id

    plain = sweep_id()
    assert plain == sweep_id("hydra/launcher=local", "num_threads=1", "tracking_uri=none")
    assert plain == sweep_id("resume=auto", f"runs_dir={tmp_path}")
    monkeypatch.chdir(tmp_path)
    assert plain == sweep_id()
    assert plain != sweep_id("seed=1")
    assert plain != sweep_id("study=other")
    assert re.fullmatch("[0-9a-f]{8}", plain)


@pytest.mark.usefixtures("trusting")
def test_a_sweep_has_runs_of_its_own_and_goes_on_with_no_other(multirun, tmp_path):
    with pytest.raises(ConfigError, match=r"^resume=.* continues that one run, but a sweep has"):
        make_plan(multirun("seed=0,1", f"resume={tmp_path}"))


def test_the_jobs_of_a_sweep_may_begin_with_a_policy(multirun, untrained_run):
    small = ("recipe=paper", "optimizer=fixed,gwo", "ppo.hidden_sizes=[16]", "env.motion=stand")
    begun, fresh = (
        make_plan(multirun(*small, *more)) for more in ([f"init_from={untrained_run}"], [])
    )
    assert len({job.identity for plan in (begun, fresh) for job in plan.jobs}) == 4
    path = untrained_run / "checkpoints" / "000005.pt"
    assert {job.config["init_from"] for job in begun.jobs} == {str(path)}
    with pytest.raises(ConfigError, match=r"ppo\.hidden_sizes is \[16\] there, \[8\] here"):
        make_plan(multirun(*small, f"init_from={untrained_run}", "ppo.hidden_sizes=[8]"))


@pytest.mark.usefixtures("trusting")
def test_cores_are_shared_out_where_the_configuration_leaves_it_open(multirun, monkeypatch):
    monkeypatch.setattr(planning, "available_cores", lambda: 8)

    def threads(*overrides):
        spec = make_plan(multirun("seed=range(4)", *overrides)).jobs[0]
        return spec.threads, spec.config["num_threads"], spec.config["physics"]["num_threads"]

    assert threads() == (8, 8, 8)
    assert threads("hydra/launcher=local") == (2, 2, 2)
    assert threads("hydra/launcher=local", "hydra.launcher.n_jobs=2") == (4, 4, 4)
    assert threads("hydra/launcher=local", "num_threads=1") == (1, 1, 2)
    assert threads("hydra/launcher=slurm") == (0, 0, 0)


@pytest.mark.usefixtures("trusting")
@pytest.mark.parametrize(
    ("overrides", "words"),
    [
        (["seed=-1,0,1"], ["job 0 (seed=-1): seed is -1", "from 0 to 2^63 - 1"]),
        (["seed=-1,-2"], ["job 0 (seed=-1): seed is -1", "job 1 (seed=-2): seed is -2"]),
        (["seed=0,1", "ppo.gamma=2"], ["ppo.gamma is 2"]),
        (
            ["seed=0,1,2,3", "optimizer=fixed,gwo", "optimizer.pack_size=10"],
            ["jobs 0 (seed=0 optimizer=fixed), 2 (seed=1 optimizer=fixed)", "and 1 more", "pack"],
        ),
        (["optimizer=gwo,gwoo"], ["job 1 (optimizer=gwoo)", "gwoo", "random"]),
        (["num_threads=1,2"], ["jobs 0 (num_threads=1) and 1 (num_threads=2) learn the same"]),
        (["seed=0,1", "optimizer=ospo", "optimizer.elites=50"], ["population", "50"]),
        (["optimizer=ospo", "optimizer.elites=10,50"], ["job 1 (optimizer.elites=50)", "elites"]),
        (["optimizer=effective_dimension", "optimizer.rest=0.5,2.0"], ["job 1", "rest"]),
        (["seed=0,1", "env.motion=3"], ["env.motion is '3'; allowed: "]),
        (["seed=0,1", "env.robot=null"], ["env.robot"]),
        (["study=a,b"], ["study must be the same in every job"]),
        (["ppo.gamma=interval(0,1)"], ["single values"]),
        (["env=glob(nothing*)"], ["env=glob(nothing*)", "nothing that it could mean"]),
        (["seed=0,1", "tracking_uri=ftp://x"], ["tracking_uri", "http://HOST:PORT"]),
    ],
)
def test_mistakes_name_their_jobs_and_come_before_anything_is_made(
    overrides, words, multirun, tmp_path
):
    with pytest.raises(ConfigError) as error:
        make_plan(multirun(*overrides, f"runs_dir={tmp_path / 'runs'}"))
    for word in words:
        assert word in str(error.value)
    assert list(tmp_path.iterdir()) == []


def test_parts_are_tried_once_for_all_jobs_that_share_them(multirun, monkeypatch):
    read, built = [], []
    monkeypatch.setattr(planning, "check_world", lambda settings, device: read.append(device))
    monkeypatch.setattr(planning, "check_lower_layer", built.append)
    make_plan(multirun("seed=0,1,2", "env.start_phase=random,zero", "optimizer=gwo,pso,cma_es"))
    assert read == [True, True]
    assert len(built) == 3
    make_plan(multirun("seed=0,1", "hydra/launcher=slurm"))
    assert read[2:] == [False]  # a login node need not have the nodes' GPU


def test_a_preset_of_ones_own_has_its_question_and_may_set_values(multirun, tmp_path, monkeypatch):
    monkeypatch.setattr(planning, "check_world", lambda settings, device: None)
    (tmp_path / "sweep").mkdir()
    (tmp_path / "sweep" / "mine.yaml").write_text(
        "# @package _global_\n# Is it\n# mine?\nseed: 5\n"
        "hydra: {mode: MULTIRUN, sweeper: {params: {optimizer: 'fixed,gwo'}}}\n"
    )
    plan = make_plan(multirun(f"hydra.searchpath=[file://{tmp_path}]", "+sweep=mine"))
    assert [job.label for job in plan.jobs] == ["optimizer=fixed", "optimizer=gwo"]
    assert {job.config["seed"] for job in plan.jobs} == {5}
    assert plan.description == "Is it mine?"
