"""tlr-evaluate takes the motion that the run was trained on, whatever has become of its file."""

import dataclasses
import hashlib
import shutil

import pytest

from tlr_exp.assembly.learner import build_ppo
from tlr_exp.assembly.world import build_clip
from tlr_exp.commands import evaluate
from tlr_exp.commands.evaluate.comparing import title_of
from tlr_exp.motion.clip import MotionClip
from tlr_exp.records.checkpoint import CheckpointStore
from tlr_exp.records.run_directory import RunDirectory


@pytest.fixture
def own_motion(short_clip_path, tmp_path):
    """A motion file that a test may edit."""
    return shutil.copy(short_clip_path, tmp_path / "mine.npz")


@pytest.fixture
def make_run(settings_of, tmp_path, own_motion):
    """``make_run(files)``: a run on that motion, whose policy was drawn and not trained."""

    def make(files=None) -> RunDirectory:
        settings = settings_of("ppo.hidden_sizes=[16]", f"env.motion={own_motion}")
        path = tmp_path / "run"
        run = RunDirectory.create(path, dataclasses.asdict(settings), tags={}, files=files)
        state = {"trainer": {"ppo": build_ppo(settings).state_dict()}}
        CheckpointStore(path / "checkpoints", keep_last=1).save(1, state)
        return run

    return make


def shortened(clip: MotionClip, frames: int) -> MotionClip:
    names = ("qpos", "qvel", "body_pos_w", "body_quat_w", "body_lin_vel_w", "body_ang_vel_w")
    return dataclasses.replace(clip, **{name: getattr(clip, name)[:frames] for name in names})


def test_the_motion_that_a_run_keeps_is_evaluated(make_run, own_motion, short_clip, robot):
    run = make_run({"env.motion": "the hash of a file that is gone"})
    shortened(short_clip, 30).save(run.motion_path)
    for forget in (False, True):
        if forget:
            own_motion.unlink()
        choice = evaluate.choose(run.path)
        assert build_clip(choice.settings.env, robot).num_frames == 30
        assert title_of([choice]).startswith("mine, iteration 1")  # as the run calls it


def test_another_file_than_the_one_trained_on_is_refused(make_run, own_motion, short_clip, capsys):
    then = hashlib.sha256(own_motion.read_bytes()).hexdigest()
    run = make_run({"env.motion": then})
    assert evaluate.choose(run.path).settings.env.motion == str(own_motion)
    shortened(short_clip, 30).save(own_motion)
    now = hashlib.sha256(own_motion.read_bytes()).hexdigest()
    assert evaluate.main([str(run.path)]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    for word in (now, then, "mine.npz (env.motion)", "was trained with"):
        assert word in error


def test_runs_of_earlier_versions_are_evaluated_on_what_is_there(
    make_run, own_motion, short_clip, robot
):
    run = make_run()
    shortened(short_clip, 30).save(own_motion)
    choice = evaluate.choose(run.path)
    assert choice.motion == choice.settings.env.motion == str(own_motion)
    assert build_clip(choice.settings.env, robot).num_frames == 30
