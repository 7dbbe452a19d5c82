"""A policy as a folder with the layout of a run directory, so that whatever reads a run reads it.

manifest.json   where the policy comes from; "policy" in it tells the folder from a run
config.yaml     the run's configuration without the places of the machine that trained
motion.npz      the clip, exact in every digit that an evaluation uses
checkpoints/    one, of the actor and the normalisation of its observation alone; and its score
"""

import json
import math
import shutil
import uuid
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import yaml

from tlr_exp.assembly.world import build_clip, build_robot_of
from tlr_exp.errors import UserError
from tlr_exp.evaluation.choosing import Choice, load_policy
from tlr_exp.export.small_clip import small_clip
from tlr_exp.keys import EVAL_PREFIX, ITERATION
from tlr_exp.records.checkpoint import CheckpointStore
from tlr_exp.records.checkpoint_files import CHECKPOINTS, read_scores
from tlr_exp.records.directory import FINISHED, MANIFEST
from tlr_exp.records.locks import ELSEWHERE
from tlr_exp.records.places import plain_command, plain_values
from tlr_exp.records.run_directory import CONFIG, MOTION, POLICY, RunDirectory
from tlr_exp.records.storage import atomic_write, json_bytes, storage_errors, sync_file, sync_folder

# What stays as the run has it. Not its process, nor its identity by which a resume would find it.
_KEPT = ("name", "created_at", "seed", "tags", "git", "tlr_exp", "packages", "python")
_OF_MACHINE = ("cpu_count", "cpu_model", "device")  # neither its name nor its system
_KEPT_WHERE_THERE = ("device_name", "files")
# Keys that say where things lay on the machine that trained, which no evaluation asks for.
_NOWHERE = {"runs_dir": "runs", "tracking_uri": "none", "init_from": None}


def check_output(output: Path, force: bool) -> None:
    """Refuse a place that is not free, before anything slow.

    With ``force`` an exported policy may be there, and nothing else: no run is ever replaced.

    Raises:
        FileExistsError: something is there that is not to be replaced.
    """
    if not output.exists() or (output.is_dir() and not any(output.iterdir())):
        return
    if not is_policy(output):
        raise FileExistsError(f"{output} exists and is no exported policy; choose another name")
    if not force:
        raise FileExistsError(f"{output} exists; --force replaces it")


def is_policy(folder: Path) -> bool:
    """Whether ``folder`` is an exported policy."""
    try:
        manifest = json.loads((folder / MANIFEST).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return False
    return isinstance(manifest, dict) and POLICY in manifest


def write_folder(choice: Choice, output: Path, force: bool) -> None:
    """Write the chosen policy as ``output``, whole or not at all.

    Raises:
        ValueError: the run has a robot model of its own, which the folder would lack; the
            checkpoint, the motion or the metrics cannot be read.
        FileExistsError: as ``check_output``.
        StorageError: the folder cannot be written; what was there before stays.
    """
    mjcf = choice.settings.env.robot.mjcf
    if mjcf is not None:
        raise UserError(
            f"{choice.run.name} was trained on a robot model of its own (env.robot.mjcf: "
            f"{Path(mjcf).name}), whose files a policy folder does not hold; only policies of the "
            "built-in robot are exported"
        )
    run = RunDirectory.open(choice.run)
    manifest = policy_manifest(run, choice.iteration)
    config = policy_config(run.config)
    score = read_scores(choice.checkpoint.parent).get(choice.iteration)
    actor = load_policy(choice).state_dict()
    clip = small_clip(build_clip(choice.settings.env, build_robot_of(choice.settings.env)))

    def fill(folder: Path) -> None:
        text = yaml.safe_dump(config, sort_keys=False, allow_unicode=True)
        atomic_write(folder / CONFIG, text.encode())
        clip.save(folder / MOTION)
        sync_file(folder / MOTION)
        # Copies on the CPU, as a tensor is saved with all of the memory that it is a part of.
        tensors = {name: tensor.detach().cpu().clone() for name, tensor in actor.items()}
        state = {"trainer": {"ppo": {"actor": tensors}}}
        CheckpointStore(folder / CHECKPOINTS, keep_last=1).save(choice.iteration, state, score)
        atomic_write(folder / MANIFEST, json_bytes(manifest, allow_nan=False))

    _put_in_place(output.resolve(), fill, force)


def policy_config(config: Mapping[str, Any]) -> dict[str, Any]:
    """The plain configuration of a run without the places that it names."""
    return plain_values({key: _NOWHERE.get(key, value) for key, value in config.items()})


def policy_manifest(run: RunDirectory, iteration: int) -> dict[str, Any]:
    """The manifest of the policy that ``run`` had after ``iteration``.

    Raises:
        ValueError: the metrics of the run are damaged.
    """
    manifest = run.manifest
    kept = {name: manifest.get(name) for name in _KEPT}
    kept |= {name: manifest[name] for name in _KEPT_WHERE_THERE if name in manifest}
    machine = {k: v for k, v in manifest.get("machine", {}).items() if k in _OF_MACHINE}
    command = plain_command(manifest.get("command", ""))
    origin = manifest.get(POLICY) or {
        "run_id": manifest["run_id"],
        "identity": manifest.get("identity", ""),
        "iteration": iteration,
        "evaluation": _evaluation(run, iteration),
    }
    # Not the run's own, or MLflow would take the folder for the run; the same at every export.
    run_id = uuid.uuid5(uuid.NAMESPACE_OID, f"{origin['run_id']}/{origin['iteration']}")
    plain = plain_values({**kept, "command": command, "machine": machine})
    return {"run_id": str(run_id), "status": FINISHED, **plain, POLICY: origin}


def _evaluation(run: RunDirectory, iteration: int) -> dict[str, float | None]:
    """What the training measured of the policy after ``iteration``; empty where it did not."""
    rows = [row for row in run.metrics() if row[ITERATION] == iteration]
    measured: Mapping[str, float] = rows[-1] if rows else {}
    return {
        name: value if math.isfinite(value) else None
        for name, value in measured.items()
        if name.startswith(EVAL_PREFIX)
    }


def _put_in_place(output: Path, fill: Callable[[Path], None], force: bool) -> None:
    """Make the folder beside its place, then rename it there; an old one goes last."""
    unique = uuid.uuid4().hex[:8]
    new = output.with_name(f".{output.name}.{unique}.new")
    old = output.with_name(f".{output.name}.{unique}.old")
    with storage_errors(f"cannot write {output}", ELSEWHERE):
        output.parent.mkdir(parents=True, exist_ok=True)
        try:
            new.mkdir()
            fill(new)
            # Anything else that is there by now lets the renaming below fail.
            if force and is_policy(output):
                output.rename(old)
            try:
                new.rename(output)
            except OSError:
                if old.exists():
                    old.rename(output)
                raise
            sync_folder(output.parent)
        finally:
            shutil.rmtree(new, ignore_errors=True)
        shutil.rmtree(old, ignore_errors=True)
