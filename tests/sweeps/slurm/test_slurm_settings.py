"""What is asked of SLURM: refused where it cannot be, derived where it is left open."""

from typing import Any

import pytest
from omegaconf import OmegaConf

from tlr_exp.sweeps.parallel import LauncherError
from tlr_exp.sweeps.slurm.settings import Needs, SlurmSettings, needs


@pytest.fixture
def read(multirun):
    """``read(*overrides)``: the settings of the preset with these changes."""

    def settings(*overrides: str) -> SlurmSettings:
        launcher = multirun("hydra/launcher=slurm", *overrides).hydra.launcher
        return SlurmSettings.read(OmegaConf.to_container(launcher, resolve=False))

    return settings


def config(num_envs: int = 256, device: str = "cpu", engine: str = "native", **threads: int) -> Any:
    return {
        "num_threads": threads.get("own", 0),
        "device": device,
        "scale": {"num_envs": num_envs},
        "physics": {"_target_": f"tlr_exp.physics.{engine}.X", "num_threads": threads.get("sim")},
    }


@pytest.mark.parametrize(
    ("asked", "words"),
    [
        (
            "hydra.launcher.signal_delay_s=20",
            "signal_delay_s=20: must be a whole number, 21 or more",
        ),
        (
            "hydra.launcher.setup='module load cuda'",
            "setup='module load cuda': must be a list of lines",
        ),
    ],
)
def test_what_would_cost_a_checkpoint_or_a_module_is_refused(read, asked, words):
    with pytest.raises(LauncherError) as refused:
        read(asked)
    assert words in str(refused.value)


@pytest.mark.parametrize(
    ("minutes", "delay"),
    [(1, 120), (1, 21), (2, 61), (3, 121)],
)
def test_limits_that_leave_no_time_are_refused_with_the_numbers(read, minutes, delay):
    asked = (f"hydra.launcher.timeout_min={minutes}", f"hydra.launcher.signal_delay_s={delay}")
    with pytest.raises(LauncherError) as refused:
        read(*asked)
    words = str(refused.value)
    assert f"hydra.launcher.timeout_min={minutes}, hydra.launcher.signal_delay_s={delay}" in words
    assert f"a job has {60 * minutes} s and is warned {delay} s before" in words
    # What it says would do does.
    enough = int(words.partition("Give timeout_min=")[2].split()[0])
    read(f"hydra.launcher.timeout_min={enough}", asked[1])
    with pytest.raises(LauncherError):
        read(f"hydra.launcher.timeout_min={enough - 1}", asked[1])


@pytest.mark.parametrize(
    ("override", "words"),
    [
        ("+hydra.launcher.nodes=2", "hydra.launcher.nodes: there is no such key"),
        ("hydra.launcher.timeout_min=1.5", "timeout_min=1.5: must be a whole number, 1 or more"),
        ("hydra.launcher.cpus_per_task=0", "cpus_per_task=0: must be a whole number, 1 or more"),
        ("hydra.launcher.max_num_timeout=-1", "must be a whole number, 0 or more"),
        ("hydra.launcher.mem_gb=0", "mem_gb=0: must be more than 0, or null"),
        ("hydra.launcher.mem_gb=much", "mem_gb=much: must be more than 0, or null"),
    ],
)
def test_values_that_cannot_be_are_named(read, override, words):
    with pytest.raises(LauncherError) as refused:
        read(override)
    assert words in str(refused.value)


def test_what_is_left_open_follows_the_largest_job_and_fits_the_largest_node(read):
    jobs = [config(256), config(512)]
    assert needs(read(), jobs, None) == Needs(8, 4096)
    assert needs(read(), jobs, Needs(2, 3000)) == Needs(2, 3000)
    assert needs(read(), [config(16)], None) == Needs(1, 4096)
    assert needs(read(), [config(4096)], None) == Needs(8, 1024 * 11)
    assert needs(read(), [config(16, own=3)], None).cpus == 3
    assert needs(read(), [config(16, own=1, sim=2)], None).cpus == 2
    on_gpu = needs(read(), [config(4096, "cuda", "mjx")], None)
    assert on_gpu == Needs(4, 1024 * 19)


def test_what_is_said_holds_whatever_the_node_has(read):
    said = read("hydra.launcher.cpus_per_task=16", "hydra.launcher.mem_gb=1.5")
    assert needs(said, [config()], Needs(2, 100)) == Needs(16, 1536)
