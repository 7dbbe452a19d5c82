"""Which policy is meant: the run, its configuration, one of its checkpoints."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tlr_exp.errors import UserError
from tlr_exp.records.checkpoint_files import CHECKPOINTS, chosen_checkpoint
from tlr_exp.records.directory import MANIFEST

if TYPE_CHECKING:
    from tlr_exp.config.settings import Settings


@dataclass(frozen=True)
class Choice:
    """What is evaluated: the run, its configuration as loaded, and one of its checkpoints.

    ``motion`` is what the run's configuration calls the motion; ``settings.env.motion`` is the clip
    that the run keeps of it, or the same where it keeps none.
    """

    run: Path
    settings: Settings
    checkpoint: Path
    iteration: int
    physics: str
    motion: str


def is_folder_of_runs(path: Path) -> bool:
    """Whether ``path`` is a folder, but none of a run or a policy."""
    return path.is_dir() and not (path / MANIFEST).is_file()


def run_of(path: Path) -> Path:
    """The directory of the run that is meant: ``path``, or of a checkpoint file the run's."""
    return path.absolute().parent.parent if path.suffix == ".pt" else path


def choose(path: Path, checkpoint: str | None = None, physics: str | None = None) -> Choice:
    """Find the run, its configuration and the checkpoint asked for.

    Args:
        path: a run directory, or a file in its ``checkpoints``.
        checkpoint: ``best``, ``last`` or an iteration; by default the best, or else the last.
        physics: name of an engine in ``conf/physics``; by default the run's own.

    Raises:
        ValueError: no such run, checkpoint or engine (the message lists what there is), or a file
            that the run was trained with holds something else now.
    """
    from tlr_exp.records.run_directory import RunDirectory

    if path.suffix == ".pt" and checkpoint is not None:
        raise UserError(f"{path} is a checkpoint already; --checkpoint needs a run directory")
    run = RunDirectory.open(run_of(path))
    from tlr_exp.config.load import load_settings
    from tlr_exp.config.past_runs import check_files, configuration_of, with_kept_motion

    config = configuration_of(run)
    motion = config["env"]["motion"]
    config = with_kept_motion(run, config)
    engine = _physics_name(config, physics)
    if physics is not None and engine != _physics_name(config, None):
        config = {**config, "physics": _physics_nodes()[engine]}
    settings = load_settings({**config, "device": _present_device(config)})
    check_files(run, config)
    file = path if path.suffix == ".pt" else chosen_checkpoint(run.path / CHECKPOINTS, checkpoint)
    if not file.stem.isdecimal():
        raise UserError(f"{file} is no checkpoint of a run: its name is not an iteration")
    return Choice(run.path, settings, file, int(file.stem), engine, motion)


def load_policy(choice: Choice) -> Any:
    """The actor of the checkpoint, on the device of ``choice.settings``.

    Raises:
        CheckpointError: the checkpoint cannot be read, or holds no policy of this configuration.
    """
    from tlr_exp.assembly.learner import build_ppo
    from tlr_exp.machine.precision import FLOAT32
    from tlr_exp.records.checkpoint import CheckpointError, load_checkpoint

    state = load_checkpoint(choice.checkpoint, choice.settings.device)
    # In full precision on any machine, whatever the policy learned in.
    actor = build_ppo(dataclasses.replace(choice.settings, precision=FLOAT32)).actor
    try:
        actor.load_state_dict(state["trainer"]["ppo"]["actor"])
    except (KeyError, RuntimeError) as error:
        reason = str(error).splitlines()[0]
        raise CheckpointError(
            f"{choice.checkpoint} holds no policy of this configuration ({reason})"
        ) from error
    return actor


def _physics_name(config: dict[str, Any], wanted: str | None) -> str:
    """Name of the engine asked for, or of the one that the configuration uses."""
    nodes = _physics_nodes()
    if wanted is None:
        target = config["physics"]["_target_"]
        names = [name for name, node in nodes.items() if node["_target_"] == target]
        return names[0] if names else target.rpartition(".")[2]
    if wanted not in nodes:
        raise UserError(f"--physics is {wanted!r}; allowed are {', '.join(nodes)}")
    return wanted


def _physics_nodes() -> dict[str, dict[str, Any]]:
    """The engines of ``conf/physics`` by name."""
    import yaml

    found = files("tlr_exp.conf").joinpath("physics").iterdir()
    nodes = {
        Path(file.name).stem: yaml.safe_load(file.read_text(encoding="utf-8"))
        for file in found
        if file.name.endswith(".yaml")
    }
    return dict(sorted(nodes.items()))


def _present_device(config: dict[str, Any]) -> str:
    import torch

    return config["device"] if torch.cuda.is_available() else "cpu"
