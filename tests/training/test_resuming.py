"""``resume=RUN``: which run continues, what else a command may set, and all refusals."""

import dataclasses
import json
import shutil

import pytest

from tlr_exp.config.identity import run_identity
from tlr_exp.config.input_files import file_hashes
from tlr_exp.config.load import ConfigError
from tlr_exp.records.checkpoint import CheckpointStore
from tlr_exp.records.directory import FINISHED, INTERRUPTED
from tlr_exp.records.extending import extensions, total_iterations
from tlr_exp.records.run_directory import RunDirectory, RunDirectoryError
from tlr_exp.training.resuming import (
    FinishedError,
    is_run,
    resumption,
    run_to_resume,
    store_of_run,
)

TINY = ("scale.num_envs=16", "scale.iterations=10", "ppo.hidden_sizes=[16]", "seed=3")


@pytest.fixture
def own_motion(short_clip_path, tmp_path):
    return shutil.copy(short_clip_path, tmp_path / "mine.npz")


@pytest.fixture
def make_run(settings_of, tmp_path, own_motion):
    """``make_run(*overrides)``: a run that was interrupted after iteration 4 of 10."""

    def make(*overrides):
        config = dataclasses.asdict(settings_of(*TINY, f"env.motion={own_motion}", *overrides))
        path = tmp_path / "runs" / "test" / "a-run"
        hashes, identity = file_hashes(config), run_identity(config)
        run = RunDirectory.create(path, config, {"experiment": "test"}, identity, hashes)
        CheckpointStore(path / "checkpoints", keep_last=1).save(4, {})
        run.set_status(INTERRUPTED)
        return run

    return make


@pytest.fixture
def run(make_run):
    return make_run()


@pytest.fixture
def resume(settings_of):
    """``resume(run, *overrides)``, as a command with these overrides does it."""

    def go_on(run, *overrides):
        keys = ["resume", *(override.partition("=")[0] for override in overrides)]
        return resumption(run, keys, dataclasses.asdict(settings_of(*overrides)))

    return go_on


def test_words_are_no_runs():
    assert not any(is_run(word) for word in ("auto", "never", "in_sweeps"))
    assert is_run("runs/tlr/a-run")


def test_a_run_goes_on_by_its_own_configuration(run, resume):
    found = resume(run)
    assert (found.settings.seed, found.settings.ppo.hidden_sizes) == (3, [16])
    assert (found.settings.scale.iterations, found.done) == (10, 4)
    before = (run.path / "manifest.json").read_bytes(), (run.path / "config.yaml").read_bytes()
    found.record()
    assert before == (
        (run.path / "manifest.json").read_bytes(),
        (run.path / "config.yaml").read_bytes(),
    )


def test_what_does_not_change_what_is_learned_may_be_said(run, resume):
    found = resume(run, "num_threads=1", "scale.evaluate_every=2", "tracking_uri=none")
    assert found.settings.num_threads == 1
    assert found.settings.scale.evaluate_every == 2
    assert found.settings.tracking_uri == "none"
    assert found.settings.scale.iterations == 10  # not that of the command's other defaults
    found.record()
    assert not extensions(run.manifest)


def test_what_would_change_the_run_is_refused_by_name_unless_it_is_so_already(run, resume):
    with pytest.raises(ConfigError) as error:
        resume(run, "seed=4", "optimizer=fixed", "ppo.gamma=0.9", "num_threads=1")
    assert f"resume={run.path} continues that run as it is" in str(error.value)
    assert f"init_from={run.path} to change seed, optimizer, ppo.gamma. " in str(error.value)
    assert "num_threads" in str(error.value).partition("may only set")[2]
    assert resume(run, "seed=3", "optimizer=gwo").settings.seed == 3
    with pytest.raises(ConfigError, match=r"study: .*where it is; move its folder"):
        resume(run, "study=other")


def test_the_name_of_another_recipe_is_refused(run, resume):
    assert resume(run, "recipe=paper").settings.recipe == "paper"
    with pytest.raises(ConfigError, match="to change recipe"):
        resume(run, "recipe=fast")


def test_another_reading_is_refused(run, resume):
    assert resume(run, "reading=none").settings.reading == "none"
    with pytest.raises(ConfigError, match="to change reading"):
        resume(run, "reading=episode")


def test_a_group_whose_other_words_are_not_learned_from_is_the_run_s_own(make_run, resume):
    scale = ("scale=laptop", "scale.num_envs=512", "scale.iterations=407")
    run = make_run(*scale, "scale.evidence=in other words", "physics.num_threads=3")
    settings = resume(run, "scale=laptop", "physics=native").settings
    assert (settings.scale.evidence, settings.physics["num_threads"]) == ("in other words", 3)
    with pytest.raises(ConfigError, match="to change scale"):
        resume(run, "scale=paper")


def test_a_key_that_the_run_does_not_have_is_refused(run, resume, settings_of):
    config = {**run.config, "physics": settings_of("physics=mjx").physics}
    run.rewrite_config(config)
    with pytest.raises(ConfigError, match=r"^physics\.num_threads: .*has no such key"):
        resume(run, "physics.num_threads=1")


@pytest.mark.parametrize(("status", "done"), [(INTERRUPTED, 4), (FINISHED, 10)])
def test_more_iterations_are_recorded_with_the_identity_of_the_longer_run(
    run, resume, settings_of, own_motion, status, done
):
    CheckpointStore(run.path / "checkpoints", keep_last=1).save(done, {})
    run.set_status(status)
    short = run.manifest["identity"]
    longer = settings_of(*TINY, f"env.motion={own_motion}", "scale.iterations=30")
    expected = run_identity(dataclasses.asdict(longer))
    own_motion.write_bytes(b"edited")  # the run keeps no clip here, so this is refused below
    with pytest.raises(ConfigError, match=r"mine\.npz \(env\.motion\) is not what a-run"):
        resume(run, "scale.iterations=30")
    shutil.copy(settings_of().env.motion, run.motion_path)  # the clip that the run keeps

    found = resume(run, "scale.iterations=30")
    assert found.settings.scale.iterations == 30
    found.record()
    (entry,) = extensions(run.manifest)
    assert (entry["from_iteration"], entry["iterations"]) == (done, 30)
    assert (entry["former_iterations"], entry["former_identity"]) == (10, short)
    assert run.manifest["identity"] == expected != short
    assert run.config["scale"]["iterations"] == total_iterations(run) == 30
    assert run.config["env"]["motion"] == str(own_motion)  # as the run calls it
    assert resume(run).settings.scale.iterations == 30


def test_a_run_whose_rate_fell_and_rises_again_is_taken_for_no_other(make_run, resume, settings_of):
    rate = ("ppo.target_kl=null", "ppo.final_learning_rate=1e-5")
    run = make_run(*rate)
    longer = settings_of(*TINY, f"env.motion={run.config['env']['motion']}", *rate)
    longer.scale.iterations = 30
    identities = [run.manifest["identity"], run_identity(dataclasses.asdict(longer))]
    resume(run, "scale.iterations=30").record()
    identities.append(run.manifest["identity"])
    CheckpointStore(run.path / "checkpoints", keep_last=1).save(12, {})
    resume(run, "scale.iterations=40").record()
    identities.append(run.manifest["identity"])
    assert len(set(identities)) == 4


def test_what_has_finished_says_how_to_get_more(run, resume):
    CheckpointStore(run.path / "checkpoints", keep_last=1).save(10, {})
    run.set_status(FINISHED)
    for overrides in ([], ["scale.iterations=10"], ["num_threads=1"]):
        with pytest.raises(FinishedError, match=r"finished its 10 iterations") as error:
            resume(run, *overrides)
        assert f"tlr-train resume={run.path} scale.iterations=N     with N above 10" in str(
            error.value
        )
    shutil.rmtree(run.path / "checkpoints")
    with pytest.raises(RunDirectoryError, match="none of its checkpoints is there"):
        resume(run, "scale.iterations=20")


@pytest.mark.parametrize("wanted", [1, 4])
def test_no_fewer_iterations_than_there_are(run, resume, wanted):
    words = rf"scale\.iterations is {wanted}, but .* trained 4 iterations already; .* above 4"
    with pytest.raises(ConfigError, match=words):
        resume(run, f"scale.iterations={wanted}")
    assert resume(run, "scale.iterations=5").settings.scale.iterations == 5


def test_what_a_run_began_with_is_needed_only_before_its_first_checkpoint(run, resume, tmp_path):
    config = {**run.config, "init_from": str(tmp_path / "gone.pt")}
    run.rewrite_config(config)
    files = {**run.manifest["files"], "init_from": "a hash"}
    run.set_status(INTERRUPTED, files=files)
    assert resume(run).settings.init_from is None
    shutil.rmtree(run.path / "checkpoints")
    with pytest.raises(ConfigError, match=r"gone\.pt is not there any more, and a-run needs it"):
        resume(run)


def test_what_is_no_run_is_told_with_what_else_resume_takes(run):
    assert run_to_resume(str(run.path)).path == run.path
    with pytest.raises(RunDirectoryError, match=r"holds these runs: a-run.*in_sweeps, never, auto"):
        run_to_resume(str(run.path.parent))


def test_a_policy_alone_cannot_be_gone_on_with(run):
    manifest = {**run.manifest, "policy": {"iteration": 4}}
    (run.path / "manifest.json").write_text(json.dumps(manifest))
    with pytest.raises(RunDirectoryError, match=r"a policy alone.*by init_from="):
        run_to_resume(str(run.path))


def test_the_store_is_that_of_the_folder_that_the_run_lies_in(run, tmp_path, monkeypatch):
    monkeypatch.delenv("MLFLOW_TRACKING_URI", raising=False)
    monkeypatch.chdir(tmp_path)
    assert store_of_run(run) == f"sqlite:///{tmp_path}/runs/mlflow.db"
    moved = RunDirectory.open(shutil.copytree(run.path, tmp_path / "else" / "a-run"))
    assert store_of_run(moved) == f"sqlite:///{tmp_path}/else/mlflow.db"
