"""``tlr-train``: one run from the command line; it wires the parts.

Many (``-m``) are taken over by ``tlr_exp.sweeps``, each of them a process that uses these parts.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

import hydra
from hydra.core.hydra_config import HydraConfig
from omegaconf import DictConfig

from tlr_exp.command_line import explain_mistakes
from tlr_exp.config import (
    CONFIG_PATH,
    ConfigError,
    load_settings,
    plain_config,
    run_identity,
    with_absolute_paths,
)
from tlr_exp.records.mirror import (
    Mirror,
    check_tracking_uri,
    default_tracking_uri,
    how_to_open,
)
from tlr_exp.records.run_directory import (
    FAILED,
    FINISHED,
    INTERRUPTED,
    RUNNING,
    RunDirectory,
    RunDirectoryError,
)
from tlr_exp.records.runs import find_or_create_run, next_run_path
from tlr_exp.records.storage import StorageError
from tlr_exp.settings import Settings

if TYPE_CHECKING:
    from tlr_exp.training import Outcome

EXIT_FAILED, EXIT_CONFIG, EXIT_INTERRUPTED = 1, 2, 130


# OpenMP's threads spin while they wait, which on a busy machine slows the policy's update several
# times. So briefly, they cost 4 % on an idle one. Read when PyTorch is imported.
OPENMP_DEFAULTS = {"GOMP_SPINCOUNT": "5000"}


def main() -> None:
    """Entry point of ``tlr-train``."""
    for name, value in OPENMP_DEFAULTS.items():
        os.environ.setdefault(name, value)
    explain_mistakes(sys.argv[1:])
    _train()  # type: ignore[call-arg]  # Hydra passes the configuration


@hydra.main(version_base="1.3", config_path=CONFIG_PATH, config_name="config")
def _train(config: DictConfig) -> None:
    with _errors_for_people():
        settings = load_settings(config)
        uri = tracking_uri(settings)
        check_inputs(settings)
        plain = with_absolute_paths(plain_config(config))
        method = HydraConfig.get().runtime.choices["optimizer"]
        run = open_run(settings, plain, method, go_on=settings.resume == "auto")
        if run.status == FINISHED:
            print(f"this configuration has been trained already: {run.path}")
            return
        with run.lock():
            outcome = train_in(run, settings, uri)
        if outcome.status != FINISHED:
            print("go on            repeat the command with resume=auto")
            sys.exit(EXIT_INTERRUPTED)


def tracking_uri(settings: Settings) -> str | None:
    """The MLflow store of a run; None where the configuration wants none.

    Raises:
        ConfigError: a URI that MLflow cannot use.
    """
    try:
        if settings.tracking_uri == "none":
            return None
        if settings.tracking_uri == "auto":
            return default_tracking_uri(settings.runs_dir)
        if "@" in settings.tracking_uri:
            # The configuration is kept in the run directory and shown in MLflow.
            raise ValueError("credentials belong into the variable MLFLOW_TRACKING_URI, not here")
        return check_tracking_uri(settings.tracking_uri)
    except ValueError as error:
        raise ConfigError(f"tracking_uri: {error}") from error


def check_inputs(settings: Settings, device: bool = True) -> None:
    """Read what the user brought, before a run directory is made and seconds of imports pass.

    Without ``device`` that is left out, for a machine that only hands work to others.

    Raises:
        ConfigError: a model that is not a G1, a motion that cannot be, or a device that is away.
    """
    from tlr_exp.motion.keyframes import load_motion
    from tlr_exp.robot import build_robot

    robot = settings.env.robot
    try:
        model = build_robot(robot.mjcf, robot.gains, robot.collisions)
        clip = load_motion(settings.env.motion, model)
    except ValueError as error:
        raise ConfigError(str(error)) from error
    if settings.env.reference_lead + 2 > clip.num_frames:
        raise ConfigError(
            f"env.reference_lead is {settings.env.reference_lead}; the motion has only "
            f"{clip.num_frames} frames"
        )
    if device and settings.device != "cpu":
        from tlr_exp.assembly import check_device

        check_device(settings.device)


def open_run(
    settings: Settings,
    config: Mapping[str, Any],
    method: str,
    go_on: bool,
    prefer_finished: bool = False,
) -> RunDirectory:
    """A new run directory of the plain ``config``, or with ``go_on`` the latest one of the same.

    With ``prefer_finished`` a finished one goes before a later one that is not.
    """
    identity = run_identity(config)
    root = Path(settings.runs_dir) / settings.study
    name = f"{settings.scale.name}-{method}-seed{settings.seed}-{identity}"
    tags = {
        "method": method,
        "scale": settings.scale.name,
        "device": settings.device,
        "motion": settings.env.motion,
        "experiment": settings.study,
    }

    def create() -> RunDirectory:
        return RunDirectory.create(next_run_path(root, name), config, tags, identity)

    if go_on:
        return find_or_create_run(root, identity, create, prefer_finished)
    return create()


def train_in(run: RunDirectory, settings: Settings, uri: str | None) -> Outcome:
    """Train in ``run``, mirrored to MLflow, and say at the end what there is to look at."""
    print(f"{run.path.name}: {settings.scale.evidence}", flush=True)
    run.set_status(RUNNING)
    mirror = Mirror.start(run, uri, settings.study)
    try:
        # Loads PyTorch, TorchRL and MuJoCo, which takes seconds: after all that can be checked.
        from tlr_exp.training import Training

        training = Training(settings, run)
        outcome = training.train()
    except BaseException as error:
        # A full disk must not hide what went wrong first.
        with suppress(StorageError):
            run.set_status(INTERRUPTED if isinstance(error, KeyboardInterrupt) else FAILED)
        mirror.finish(timeout_s=10.0)
        raise
    mirrored = mirror.finish()
    print(f"\n{outcome.status} after iteration {outcome.iteration} of {settings.scale.iterations}")
    _say_what_is_there(run, training.store.best(), uri)
    if not mirrored:
        print(f"not all of it has reached MLflow yet; bring it there:  {mirror.sync_command}")
    return outcome


def _say_what_is_there(run: RunDirectory, best: Path | None, uri: str | None) -> None:
    print(f"run directory    {run.path}")
    if best is not None:
        print(f"best checkpoint  {best}")
    print(f"evaluate         tlr-evaluate {run.path}")
    if uri is not None:
        print(f"dashboard        {how_to_open(uri, run.path.parent.parent)}")


@contextmanager
def _errors_for_people() -> Iterator[None]:
    """Errors that have an explanation are printed without a traceback."""
    try:
        yield
    except (ConfigError, RunDirectoryError) as error:
        print(error, file=sys.stderr)
        sys.exit(EXIT_CONFIG)
    except KeyboardInterrupt:
        print("interrupted; go on by the same command with resume=auto", file=sys.stderr)
        sys.exit(EXIT_INTERRUPTED)
    except (StorageError, *explained_failures()) as error:
        print(error, file=sys.stderr)
        sys.exit(EXIT_FAILED)


def explained_failures() -> tuple[type[Exception], ...]:
    """Failures of a training that say what to do; loaded by then, if they can occur at all."""
    training = sys.modules.get("tlr_exp.training")
    return () if training is None else training.EXPLAINED_FAILURES


if __name__ == "__main__":
    main()
