"""A run trained further than it was asked to at first: what its manifest says of that.

The manifest is written first and says all; ``config.yaml`` follows. Where a kill comes between the
two, `complete_extension` writes the rest.
"""

from collections.abc import Mapping
from typing import Any

from tlr_exp.records.directory import RUNNING, utc_now
from tlr_exp.records.run_directory import RunDirectory

EXTENDED = "extended"  # the manifest's list of extensions, oldest first
ITERATIONS = "scale.iterations"


def extend(run: RunDirectory, iterations: int, done: int, identity: str) -> None:
    """Record that the run, of whom this process holds the lock, goes on to another length.

    Args:
        run: its configuration still has the former length.
        iterations: the new total.
        done: iterations that are in its newest checkpoint.
        identity: of its configuration with the new total.

    Raises:
        StorageError: the manifest or the configuration cannot be written.
    """
    manifest = run.manifest
    entry = {
        "at": utc_now(),
        "from_iteration": done,
        "iterations": iterations,
        "former_iterations": total_iterations(run),
        "former_identity": manifest.get("identity", ""),
    }
    run.set_status(RUNNING, identity=identity, extended=[*extensions(manifest), entry])
    complete_extension(run)


def complete_extension(run: RunDirectory) -> None:
    """Let ``config.yaml`` say the length that the manifest says, where it does not.

    Raises:
        StorageError: it cannot be written.
    """
    if not extensions(run.manifest):
        return
    config, total = run.config, total_iterations(run)
    if config["scale"]["iterations"] != total:
        scale = {**config["scale"], "iterations": total}
        run.rewrite_config({**config, "scale": scale})


def total_iterations(run: RunDirectory) -> int:
    """The number of iterations that the run is to have at its end."""
    made = extensions(run.manifest)
    return made[-1]["iterations"] if made else run.config["scale"]["iterations"]


def former_totals(manifest: Mapping[str, Any]) -> list[int]:
    """The lengths that a run had before each of its extensions, oldest first."""
    return [entry["former_iterations"] for entry in extensions(manifest)]


def extensions(manifest: Mapping[str, Any]) -> list[dict[str, Any]]:
    """The entries of a manifest on its extensions; none in runs that were never extended."""
    return list(manifest.get(EXTENDED) or [])
