"""The motion that a run keeps: bit for bit, and whatever becomes of the file."""

import dataclasses
import hashlib

import numpy as np
import pytest
from learners import build_training

from tlr_exp.config.input_files import motion_content
from tlr_exp.motion.clip import MotionClip
from tlr_exp.records.run_directory import RunDirectory
from tlr_exp.records.storage import StorageError
from tlr_exp.robot.g1 import G1
from tlr_exp.training.kept_motion import kept_motion
from tlr_exp.training.run import open_run


@pytest.fixture
def run(tmp_path):
    return RunDirectory.create(tmp_path / "run", {"seed": 0}, {})


def arrays(clip: MotionClip) -> dict[str, np.ndarray]:
    values = {field.name: getattr(clip, field.name) for field in dataclasses.fields(clip)}
    return {name: value for name, value in values.items() if isinstance(value, np.ndarray)}


def test_what_is_kept_is_the_first_clip_to_the_bit(run, short_clip):
    shorter = {name: array[:30] for name, array in arrays(short_clip).items()}
    other = dataclasses.replace(short_clip, **shorter)
    first, second = kept_motion(run, short_clip), kept_motion(run, other)
    assert len(arrays(short_clip)) == 6
    for name, array in arrays(short_clip).items():
        np.testing.assert_array_equal(arrays(first)[name], array)
        np.testing.assert_array_equal(arrays(second)[name], array)
    # 115 kB a second of motion: small beside a checkpoint.
    assert run.motion_path.stat().st_size < 200_000 * short_clip.duration_s


def test_a_folder_that_cannot_be_written_is_named(run, short_clip, monkeypatch):
    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(MotionClip, "save", full)
    with pytest.raises(StorageError, match=r"cannot write .*run/motion\.npz: No space left"):
        kept_motion(run, short_clip)


def test_a_training_keeps_its_motion_and_goes_on_with_it(run, settings_of, short_clip, tmp_path):
    settings = settings_of("scale.num_envs=16", "ppo.hidden_sizes=[16]")
    assert build_training(settings, run).env.reference.num_frames == short_clip.num_frames
    kept = arrays(MotionClip.load(run.motion_path, G1))
    np.testing.assert_array_equal(kept["qpos"], short_clip.qpos)
    shorter = {name: array[:30] for name, array in kept.items()}
    dataclasses.replace(short_clip, **shorter).save(tmp_path / "edited.npz")
    settings.env.motion = str(tmp_path / "edited.npz")
    assert build_training(settings, run).env.reference.num_frames == short_clip.num_frames


def test_a_new_run_knows_what_its_files_held(settings_of, tmp_path):
    settings = settings_of(f"runs_dir={tmp_path}", "env.motion=wave")
    run = open_run(settings, dataclasses.asdict(settings), "gwo", go_on=False)
    expected = hashlib.sha256(motion_content("wave")).hexdigest()
    assert run.manifest["files"] == {"env.motion": expected}
    assert run.path.name.endswith(run.manifest["identity"])
