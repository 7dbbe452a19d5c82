"""The files of a run that was made before: which must still hold what they held."""

import dataclasses
import hashlib

import pytest

from tlr_exp.config.input_files import INITIAL, MODEL, MOTION, file_hashes
from tlr_exp.config.past_runs import check_files, configuration_of, with_kept_motion
from tlr_exp.records.run_directory import RunDirectory, RunDirectoryError


@pytest.fixture
def start(tmp_path):
    path = tmp_path / "start.pt"
    path.write_bytes(b"weights")
    return path


@pytest.fixture
def run(settings_of, tmp_path, start):
    config = {**dataclasses.asdict(settings_of()), INITIAL: str(start)}
    return RunDirectory.create(tmp_path / "run", config, {}, files=file_hashes(config))


def test_what_a_policy_began_with_matters_only_where_it_is_asked_for(run, start):
    assert run.manifest["files"][INITIAL] == hashlib.sha256(b"weights").hexdigest()
    check_files(run, run.config, (MOTION, MODEL, INITIAL))
    start.write_bytes(b"other weights")
    check_files(run, run.config)
    with pytest.raises(ValueError, match=r"start\.pt \(init_from\) is not what run was trained"):
        check_files(run, run.config, (MOTION, MODEL, INITIAL))
    start.unlink()
    check_files(run, run.config)
    with pytest.raises(ValueError, match=r"start\.pt is not there any more, and run needs it"):
        check_files(run, run.config, (MOTION, MODEL, INITIAL))


def test_the_kept_motion_stands_in_for_a_file_that_is_gone(run, short_clip):
    assert with_kept_motion(run, run.config) == run.config
    short_clip.save(run.motion_path)
    config = with_kept_motion(run, run.config)
    assert config["env"]["motion"] == str(run.motion_path)
    check_files(run, config)


def test_a_configuration_that_was_cut_off_is_told_with_what_it_lacks(run):
    assert configuration_of(run)["env"] == run.config["env"]
    path = run.path / "config.yaml"
    path.write_text(path.read_text().partition("\nphysics:")[0] + "\n")
    with pytest.raises(RunDirectoryError, match=r"config\.yaml is not whole: it lacks .*physics"):
        configuration_of(run)
    path.write_text("")
    with pytest.raises(RunDirectoryError, match=r"it lacks env\.motion, env\.robot, physics"):
        configuration_of(run)
    path.write_text("env:\n  motion: walk\n  max_le\n")
    with pytest.raises(RunDirectoryError, match=r"^cannot read .*config\.yaml: .*max_le") as error:
        configuration_of(run)
    assert "\n" not in str(error.value)
