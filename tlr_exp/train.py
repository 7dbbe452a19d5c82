"""``tlr-train``: one run from the command line (``-m`` for many); it wires the parts."""

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import hydra
from hydra.core.hydra_config import HydraConfig
from hydra.types import RunMode
from omegaconf import DictConfig

from tlr_exp.command_line import explain_mistakes
from tlr_exp.config import (
    CONFIG_PATH,
    NOT_IDENTITY,
    ConfigError,
    file_hashes,
    load_settings,
    plain_config,
    with_absolute_paths,
)
from tlr_exp.records.mirror import (
    Mirror,
    check_tracking_uri,
    default_tracking_uri,
    hide_password,
)
from tlr_exp.records.run_directory import (
    FAILED,
    FINISHED,
    INTERRUPTED,
    RUNNING,
    RunDirectory,
    RunDirectoryError,
)
from tlr_exp.records.runs import config_hash, find_run, next_run_path
from tlr_exp.records.storage import StorageError
from tlr_exp.settings import Settings

EXIT_FAILED, EXIT_CONFIG, EXIT_INTERRUPTED = 1, 2, 130


def main() -> None:
    """Entry point of ``tlr-train``."""
    # OpenMP's threads spin while they wait, which on a busy machine slows the policy's update
    # several times. So briefly, they cost 4 % on an idle one. Read when PyTorch is imported.
    os.environ.setdefault("GOMP_SPINCOUNT", "5000")
    explain_mistakes(sys.argv[1:])
    _train()  # type: ignore[call-arg]  # Hydra passes the configuration


@hydra.main(version_base="1.3", config_path=CONFIG_PATH, config_name="config")
def _train(config: DictConfig) -> None:
    with _errors_for_people():
        settings = load_settings(config)
        uri = tracking_uri(settings)
        check_inputs(settings)
        run = open_run(settings, config)
        if run.status == FINISHED:
            print(f"this configuration has been trained already: {run.path}")
            return
        with run.lock():
            train_in(run, settings, uri)


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


def check_inputs(settings: Settings) -> None:
    """Read what the user brought, before a run directory is made and seconds of imports pass.

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
    if settings.device != "cpu":
        from tlr_exp.assembly import check_device

        check_device(settings.device)


def open_run(settings: Settings, config: DictConfig) -> RunDirectory:
    """A new run directory, or with ``resume=auto`` the latest one of the same configuration."""
    plain = with_absolute_paths(plain_config(config))
    identity = config_hash({**plain, "files": file_hashes(plain)}, NOT_IDENTITY)
    root = Path(settings.runs_dir) / settings.study
    method = HydraConfig.get().runtime.choices["optimizer"]
    found = find_run(root, identity) if settings.resume == "auto" and root.is_dir() else None
    if found is not None:
        return found
    name = f"{settings.scale.name}-{method}-seed{settings.seed}-{identity}"
    tags = {
        "method": method,
        "scale": settings.scale.name,
        "device": settings.device,
        "motion": settings.env.motion,
        "experiment": settings.study,
    }
    return RunDirectory.create(next_run_path(root, name), plain, tags, identity)


def train_in(run: RunDirectory, settings: Settings, uri: str | None) -> None:
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
    if outcome.status != FINISHED:
        print("go on            repeat the command with resume=auto")
        sys.exit(EXIT_INTERRUPTED)


def _say_what_is_there(run: RunDirectory, best: Path | None, uri: str | None) -> None:
    print(f"run directory    {run.path}")
    if best is not None:
        print(f"best checkpoint  {best}")
    print(f"evaluate         tlr-evaluate {run.path}")
    if uri is not None:
        served = uri.startswith("http")
        address = hide_password(uri)
        print(f"dashboard        {'' if served else 'mlflow server --backend-store-uri '}{address}")


@contextmanager
def _errors_for_people() -> Iterator[None]:
    """Errors that have an explanation are printed without a traceback.

    In a sweep (``-m``) they are left to Hydra, which goes on with the other jobs.
    """
    if HydraConfig.get().mode == RunMode.MULTIRUN:
        yield
        return
    try:
        yield
    except (ConfigError, RunDirectoryError) as error:
        print(error, file=sys.stderr)
        sys.exit(EXIT_CONFIG)
    except KeyboardInterrupt:
        print("interrupted; go on by the same command with resume=auto", file=sys.stderr)
        sys.exit(EXIT_INTERRUPTED)
    except (StorageError, *_explained_failures()) as error:
        print(error, file=sys.stderr)
        sys.exit(EXIT_FAILED)


def _explained_failures() -> tuple[type[Exception], ...]:
    """Failures of a training that say what to do; loaded by then, if they can occur at all."""
    training = sys.modules.get("tlr_exp.training")
    return () if training is None else training.EXPLAINED_FAILURES


if __name__ == "__main__":
    main()
