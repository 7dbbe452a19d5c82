"""Submitting to a SLURM whose answers come too late, with commands that only note and answer."""

from dataclasses import replace

import pytest
from omegaconf import OmegaConf

from tlr_exp.sweeps.parallel import LauncherError
from tlr_exp.sweeps.slurm import commands
from tlr_exp.sweeps.slurm.commands import UnreachableError
from tlr_exp.sweeps.slurm.elements import read_elements
from tlr_exp.sweeps.slurm.launcher import SlurmLauncher

# Notes the comment of an array and takes it; the first time it gives no answer.
SBATCH = """#!/bin/sh
for word in "$@"; do case $word in --comment=*) comment=${word#--comment=};; esac; done
echo "$comment" >> {folder}/arrays
if [ $(wc -l < {folder}/arrays) = 1 ]; then exec sleep 60; fi
wc -l < {folder}/arrays
"""
# Of each array the elements 0 to 2, in the columns that are asked for.
SQUEUE = """#!/bin/sh
number=0
while read -r comment; do
  number=$((number + 1))
  for index in 0 1 2; do
    printf '%-40s%-24s%-12s%-250s%-200s\\n' ${number}_$index PENDING 0 "$comment" Priority
  done
done < {folder}/arrays
"""


@pytest.fixture
def launcher(plan, sweep, tmp_path, monkeypatch, multirun):
    """A launcher for the plan, whose SLURM takes what it is given and is slow to say so."""
    folder = tmp_path / "bin"
    folder.mkdir()
    scripts = {
        "sbatch": SBATCH,
        "squeue": SQUEUE,
        "scontrol": "#!/bin/sh\n",
        "sinfo": "#!/bin/sh\n",
    }
    for name, text in scripts.items():
        (folder / name).write_text(text.replace("{folder}", str(folder)))
        (folder / name).chmod(0o755)
    (folder / "arrays").touch()
    monkeypatch.setenv("PATH", f"{folder}:/usr/bin:/bin")
    config = {"device": "cpu", "physics": {}, "scale": {"num_envs": 16, "iterations": 10}}
    jobs = [replace(job, config={**job.config, **config}) for job in plan.jobs]
    asked = multirun("hydra/launcher=slurm").hydra.launcher
    settings = OmegaConf.to_container(asked, resolve=False)
    return SlurmLauncher({**settings, "name": "tlr"}, replace(plan, jobs=tuple(jobs)))


def test_an_array_that_was_taken_without_an_answer_is_found_and_not_submitted_again(
    launcher, sweep, monkeypatch
):
    assert launcher.held() == set()
    monkeypatch.setattr(commands, "ANSWER_S", 2.0)
    with pytest.raises(UnreachableError, match="the same command looks for them in the queue"):
        launcher.submit(launcher.plan.jobs)
    assert read_elements(sweep.path) == {}
    monkeypatch.setattr(commands, "ANSWER_S", 60.0)
    assert launcher.held() == {0, 1, 2}
    assert read_elements(sweep.path) == {0: "1_0", 1: "1_1", 2: "1_2"}
    assert "scancel 1_[0-2]" in launcher.left_in_the_queue()


def test_elements_of_an_array_that_begins_later_are_later_jobs():
    name = commands.comment_of("tlr_exp tlr many-0011aabb", 1000)
    assert commands._num("7_3", name.removeprefix("tlr_exp tlr many-0011aabb")) == 1003
    assert commands._num("7_3", "") is None  # as earlier versions submitted it


def test_a_machine_without_slurm_is_called_that_at_once(plan, tmp_path, monkeypatch):
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(LauncherError, match="there is no sbatch here"):
        SlurmLauncher({}, plan)
