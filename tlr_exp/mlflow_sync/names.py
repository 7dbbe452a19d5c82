"""Names a run's configuration and manifest for MLflow: parameters, tags, metrics.

Those of a sweep's run are in sweep_page.py.

Pure functions on plain data, within MLflow's limits on characters and lengths.
"""

import json
import re
from collections.abc import Mapping
from typing import Any

from tlr_exp.config.nested import flat
from tlr_exp.records.directory import FAILED, FINISHED, RUNNING
from tlr_exp.records.extending import extensions

RUN_ID_TAG = "tlr_exp.run_id"
STATUS_TAG = "tlr_exp.status"
FILES_TAG = "tlr_exp.files"
KIND_TAG = "kind"  # "run" or "sweep"
SWEEP_TAG = "sweep"  # of a sweep its directory's name; of a run those of all that it belongs to
BEST_CHECKPOINT_TAG, FINAL_CHECKPOINT_TAG = "best_checkpoint", "final_checkpoint"  # artifacts
EXTENDED_TAG = "extended_to"  # of a run trained further: how many iterations it has at its end
VERSION_PREFIX = "version."  # and the name of a package
PARENT_TAG = "mlflow.parentRunId"
KIND_RUN, KIND_SWEEP = "run", "sweep"

_MAX_NAME, _MAX_PARAM, _MAX_TAG = 250, 6000, 5000
_FORBIDDEN = re.compile(r"[^\w\-./: ]")


def plain_name(name: str) -> str:
    """`name` with every character that MLflow refuses (brackets, for one) made an underscore."""
    return _FORBIDDEN.sub("_", name)[:_MAX_NAME]


def flat_parameters(config: Mapping[str, Any]) -> dict[str, str]:
    """A nested configuration as {"a.b.c": text}; lists and empty dicts as JSON, cut to 6000."""
    return {plain_name(key): _text(value)[:_MAX_PARAM] for key, value in flat(config).items()}


def run_tags(manifest: Mapping[str, Any], status: str) -> dict[str, str]:
    """The tags of a run: its own labels, identity, status, source revision, versions, machine."""
    git = manifest.get("git") or {}
    machine = manifest.get("machine") or {}
    tags: dict[str, Any] = {
        RUN_ID_TAG: manifest["run_id"],
        STATUS_TAG: status,
        KIND_TAG: KIND_RUN,
        "identity": manifest.get("identity"),
        "seed": manifest.get("seed"),
        "device": machine.get("device"),
        "precision": manifest.get("precision"),
        "host": machine.get("host"),
        "cpu_model": machine.get("cpu_model"),
        "git_commit": git.get("commit"),
        "git_dirty": git.get("dirty"),
        "command": manifest.get("command"),
        f"{VERSION_PREFIX}tlr_exp": manifest.get("tlr_exp"),
        f"{VERSION_PREFIX}python": manifest.get("python"),
        # What MLflow's own pages show as version and source.
        "mlflow.source.git.commit": git.get("commit"),
        "mlflow.source.name": program(manifest.get("command")),
    }
    packages = manifest.get("packages") or {}
    tags |= {f"{VERSION_PREFIX}{name}": text for name, text in packages.items()}
    tags |= manifest.get("tags") or {}
    if made := extensions(manifest):  # a parameter of MLflow keeps its first value
        tags[EXTENDED_TAG] = made[-1]["iterations"]
    return plain_tags(tags)


def program(command: str | None) -> str | None:
    """The program of a command line, for the column "Source", which shows what follows a slash."""
    return command.split()[0] if command and command.strip() else None


def plain_tags(tags: Mapping[str, Any]) -> dict[str, str]:
    """`tags` within MLflow's limits, without those that are None."""
    known = {name: value for name, value in tags.items() if value is not None}
    return {plain_name(name): _text(value)[:_MAX_TAG] for name, value in known.items()}


def mlflow_status(status: str) -> str:
    """MLflow's word for a run status."""
    return {RUNNING: "RUNNING", FINISHED: "FINISHED", FAILED: "FAILED"}.get(status, "KILLED")


def _text(value: Any) -> str:
    return value if isinstance(value, str) else json.dumps(value, default=str, ensure_ascii=False)
