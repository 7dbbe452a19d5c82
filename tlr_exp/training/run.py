"""One run from checked settings to its end, whoever asks for it: a command, or a job of a sweep."""

from __future__ import annotations

import re
import sys
import traceback
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tlr_exp.config.identity import run_identity
from tlr_exp.config.input_files import file_hashes
from tlr_exp.config.limits import check_starts
from tlr_exp.config.load import ConfigError, instantiate
from tlr_exp.config.settings import Settings
from tlr_exp.mlflow_sync.mirror import Mirror
from tlr_exp.mlflow_sync.tracking_uri import check_tracking_uri, default_tracking_uri, how_to_open
from tlr_exp.records.credentials import has_credentials
from tlr_exp.records.directory import FAILED, INTERRUPTED, RUNNING
from tlr_exp.records.extending import complete_extension
from tlr_exp.records.run_directory import RunDirectory, RunDirectoryError
from tlr_exp.records.runs import find_or_create_run, next_run_path
from tlr_exp.records.storage import StorageError
from tlr_exp.robot.g1 import CONTROL_DT_S

if TYPE_CHECKING:
    from tlr_exp.training.loop import Outcome

EXIT_FAILED, EXIT_CONFIG, EXIT_INTERRUPTED = 1, 2, 130

# How Python says that a caller gave wrong arguments: here, that a configuration did.
_WRONG_ARGUMENTS = re.compile(
    r"unexpected keyword argument|missing \d+ required|positional argument"
)


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
        if has_credentials(settings.tracking_uri):
            # The configuration is kept in the run directory and shown in MLflow.
            raise ValueError("credentials belong into the variable MLFLOW_TRACKING_URI, not here")
        return check_tracking_uri(settings.tracking_uri)
    except ValueError as error:
        raise ConfigError(f"tracking_uri: {error}") from error


def check_inputs(settings: Settings) -> None:
    """Try what the configuration names, before a run directory is made.

    Raises:
        ConfigError: see `check_world`, `check_lower_layer` and `check_beginning`.
    """
    check_world(settings)
    check_lower_layer(settings)
    check_beginning(settings)


def check_world(settings: Settings, device: bool = True) -> None:
    """Read the model and the motion, and look for the device.

    Without ``device`` that is left out, for a machine that only hands work to others.

    Raises:
        ConfigError: a model that is not a G1, a motion that cannot be, or a device that is away.
    """
    from tlr_exp.motion.authoring.keyframes import load_motion
    from tlr_exp.motion.clip import resample
    from tlr_exp.robot.model import build_robot

    robot = settings.env.robot
    try:
        model = build_robot(robot.mjcf, robot.gains, robot.collisions)
        clip = resample(load_motion(settings.env.motion, model), 1.0 / CONTROL_DT_S, model)
    except ValueError as error:
        raise ConfigError(str(error)) from error
    if settings.env.reference_lead + 2 > clip.num_frames:
        raise ConfigError(
            f"env.reference_lead is {settings.env.reference_lead}; the motion has only "
            f"{clip.num_frames} frames at the control rate of {clip.fps:g} Hz, and "
            f"{settings.env.reference_lead + 2} are needed"
        )
    try:
        num_steps = clip.num_frames - 1 - settings.env.reference_lead
        check_starts("scale.evaluate_starts", settings.scale.evaluate_starts, num_steps)
    except ValueError as error:
        raise ConfigError(str(error)) from error
    if device and settings.device != "cpu":
        from tlr_exp.assembly.learner import check_device

        check_device(settings.device)


def check_lower_layer(settings: Settings) -> None:
    """Build the objective and the weight optimizer, which check their settings themselves.

    Raises:
        ConfigError: one of them refuses its settings, or lacks a package.
    """
    objective = instantiate(settings.reward.objective)
    num_terms = len(settings.reward.optimizing)
    instantiate(settings.optimizer, num_terms=num_terms, objective=objective, seed=0, device="cpu")


def check_beginning(settings: Settings) -> None:
    """Look at the checkpoint that the policy begins as, where there is one.

    Raises:
        ConfigError: it is not there, or holds other networks than those of the configuration.
    """
    if settings.init_from is not None:
        from tlr_exp.training.initial_policy import check_initial_policy

        check_initial_policy(settings)


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
        "recipe": settings.recipe,
        "device": settings.device,
        "motion": settings.env.motion,
        "experiment": settings.study,
    }

    def create() -> RunDirectory:
        path = next_run_path(root, name)
        return RunDirectory.create(path, config, tags, identity, file_hashes(config))

    if go_on:
        return find_or_create_run(root, identity, create, prefer_finished)
    return create()


def train_in(run: RunDirectory, settings: Settings, uri: str | None) -> Outcome:
    """Train in ``run``, mirrored to MLflow, and say at the end what there is to look at."""
    print(f"{run.path.name}: {settings.scale.evidence}", flush=True)
    run.set_status(RUNNING)
    complete_extension(run)
    mirror = Mirror.start(run, uri, settings.study)
    try:
        # Loads PyTorch, TorchRL and MuJoCo, which takes seconds: after all that can be checked.
        from tlr_exp.training.loop import Training

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
        print(mirror.what_is_missing)
    return outcome


def _say_what_is_there(run: RunDirectory, best: Path | None, uri: str | None) -> None:
    print(f"run directory    {run.path}")
    if best is not None:
        print(f"best checkpoint  {best}")
    print(f"evaluate         tlr-evaluate {run.path}")
    if uri is not None:
        print(f"dashboard        {how_to_open(uri, run.path.parent.parent)}")


def print_error(error: BaseException) -> None:
    """Say on stderr what went wrong; with a traceback where the message does not say it all."""
    explained = (ConfigError, RunDirectoryError, StorageError, *explained_failures())
    if isinstance(error, explained) and not _hides_a_bug(error):
        print(error, file=sys.stderr)
    else:
        traceback.print_exception(error)


def explained_failures() -> tuple[type[Exception], ...]:
    """Failures of a training that say what to do; loaded by then, if they can occur at all."""
    training = sys.modules.get("tlr_exp.training.loop")
    return () if training is None else training.EXPLAINED_FAILURES


def _hides_a_bug(error: BaseException) -> bool:
    """Whether a part broke while it was built, for another reason than what it was given."""
    cause = error.__cause__
    return isinstance(cause, TypeError) and _WRONG_ARGUMENTS.search(str(cause)) is None
