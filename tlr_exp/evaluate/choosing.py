"""Which policy is meant: the run, its configuration, one of its checkpoints."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from tlr_exp.records.run_directory import RunDirectory
    from tlr_exp.settings import Settings

BEST, LAST = "best", "last"


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

    run_path = path
    if path.suffix == ".pt":
        if checkpoint is not None:
            raise ValueError(f"{path} is a checkpoint already; --checkpoint needs a run directory")
        run_path = path.absolute().parent.parent
    run = RunDirectory.open(run_path)
    from tlr_exp.config import load_settings, of_any_version

    config = of_any_version(run.config)
    motion = config["env"]["motion"]
    config = with_kept_motion(run, config)
    engine = _physics_name(config, physics)
    if physics is not None and engine != _physics_name(config, None):
        config = {**config, "physics": _physics_nodes()[engine]}
    settings = load_settings({**config, "device": _present_device(config)})
    check_files(run, config)
    file = path if path.suffix == ".pt" else _checkpoint_file(run.path / "checkpoints", checkpoint)
    if not file.stem.isdecimal():
        raise ValueError(f"{file} is no checkpoint of a run: its name is not an iteration")
    return Choice(run.path, settings, file, int(file.stem), engine, motion)


def with_kept_motion(run: RunDirectory, config: dict[str, Any]) -> dict[str, Any]:
    """The configuration on the clip that the run keeps, where it keeps one."""
    if not run.motion_path.is_file():
        return config
    return {**config, "env": {**config["env"], "motion": str(run.motion_path)}}


def check_files(run: RunDirectory, config: dict[str, Any]) -> None:
    """Refuse files that are known to hold something else than when the run was trained.

    Args:
        run: its manifest knows the hashes, unless an earlier version made it.
        config: from ``with_kept_motion``.

    Raises:
        ValueError: names the file and both hashes.
    """
    from tlr_exp.input_files import file_hashes

    env, now = config["env"], file_hashes(config)
    named = {"env.motion": env["motion"], "env.robot.mjcf": env["robot"]["mjcf"]}
    for key, then in run.manifest.get("files", {}).items():
        if named[key] != str(run.motion_path) and now[key] != then:
            raise ValueError(
                f"{named[key]} ({key}) is not what {run.path.name} was trained with: its SHA-256 "
                f"is {now[key]}, and was {then}. Put back what it held then"
            )


def load_policy(choice: Choice) -> Any:
    """The actor of the checkpoint, on the device of ``choice.settings``.

    Raises:
        CheckpointError: the checkpoint cannot be read, or holds no policy of this configuration.
    """
    from tlr_exp.assembly import build_ppo
    from tlr_exp.precision import FLOAT32
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


def _checkpoint_file(folder: Path, wanted: str | None) -> Path:
    from tlr_exp.records.checkpoint import CheckpointStore

    store = CheckpointStore(folder, keep_last=1)  # only read: keep_last is of no consequence
    iterations = store.iterations()
    if not iterations:
        raise ValueError(f"{folder} holds no checkpoint yet")
    if wanted is not None and wanted.isdecimal() and int(wanted) in iterations:
        return store.path_of(int(wanted))
    named = {None: store.best() or store.latest(), BEST: store.best(), LAST: store.latest()}
    file = named.get(wanted)
    if file is None:
        names = [*(str(i) for i in iterations), LAST, *([BEST] if store.best() else [])]
        raise ValueError(f"{folder} has no checkpoint {wanted!r}; it has {', '.join(names)}")
    return file


def _physics_name(config: dict[str, Any], wanted: str | None) -> str:
    """Name of the engine asked for, or of the one that the configuration uses."""
    nodes = _physics_nodes()
    if wanted is None:
        target = config["physics"]["_target_"]
        names = [name for name, node in nodes.items() if node["_target_"] == target]
        return names[0] if names else target.rpartition(".")[2]
    if wanted not in nodes:
        raise ValueError(f"--physics is {wanted!r}; allowed are {', '.join(nodes)}")
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
