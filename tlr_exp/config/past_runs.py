"""A run that was made before: its configuration on the files that it was trained with."""

from collections.abc import Collection
from typing import Any

from tlr_exp.config.input_files import INITIAL, MODEL, MOTION, file_hashes
from tlr_exp.config.nested import value_at
from tlr_exp.config.versions import of_any_version
from tlr_exp.errors import UserError
from tlr_exp.records.run_directory import CONFIG, RunDirectory, RunDirectoryError

# What is read of a configuration before it is compared with the schema, which tells of the rest.
_NEEDED = (MOTION, "env.robot", "physics._target_", "scale.iterations", "device")


def configuration_of(run: RunDirectory) -> dict[str, Any]:
    """The plain configuration of a run of any version, as this version reads it.

    Raises:
        RunDirectoryError: it cannot be read, or part of it is missing.
    """
    config = of_any_version(run.config)
    missing = [key for key in _NEEDED if value_at(config, key) is None]
    if missing:
        raise RunDirectoryError(f"{run.path / CONFIG} is not whole: it lacks {', '.join(missing)}")
    return config


def with_kept_motion(run: RunDirectory, config: dict[str, Any]) -> dict[str, Any]:
    """The configuration on the clip that the run keeps, where it keeps one."""
    if not run.motion_path.is_file():
        return config
    return {**config, "env": {**config["env"], "motion": str(run.motion_path)}}


def check_files(
    run: RunDirectory, config: dict[str, Any], keys: Collection[str] = (MOTION, MODEL)
) -> None:
    """Refuse files that are known to hold something else than when the run was made.

    Args:
        run: its manifest knows the hashes, unless an earlier version made it.
        config: from ``with_kept_motion``.
        keys: which files; what a policy began from matters only before its first checkpoint.

    Raises:
        ValueError: names the file and both hashes, or a file that is gone.
    """
    env = config["env"]
    named = {
        MOTION: env["motion"],
        MODEL: env["robot"]["mjcf"],
        INITIAL: config.get(INITIAL),
    }
    known = {key: then for key, then in run.manifest.get("files", {}).items() if key in keys}
    if not known:
        return
    try:
        now = file_hashes(config if INITIAL in known else {**config, INITIAL: None})
    except FileNotFoundError as error:
        raise UserError(
            f"{error.filename} is not there any more, and {run.path.name} needs it"
        ) from error
    for key, then in known.items():
        if named[key] != str(run.motion_path) and now[key] != then:
            raise UserError(
                f"{named[key]} ({key}) is not what {run.path.name} was trained with: its SHA-256 "
                f"is {now[key]}, and was {then}. Put back what it held then"
            )
