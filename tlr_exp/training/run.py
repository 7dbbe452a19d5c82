"""One run from checked settings to its end, whoever asks for it: a command, or a job of a sweep."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tlr_exp.assembly.parts import Parts
from tlr_exp.config.components import check_component
from tlr_exp.config.identity import run_identity
from tlr_exp.config.input_files import file_hashes
from tlr_exp.config.limits import check_starts
from tlr_exp.config.load import ConfigError
from tlr_exp.config.settings import Settings
from tlr_exp.errors import UserError
from tlr_exp.mlflow_sync.mirror import Mirror
from tlr_exp.mlflow_sync.tracking_uri import check_tracking_uri, default_tracking_uri, how_to_open
from tlr_exp.records.credentials import has_credentials
from tlr_exp.records.directory import FAILED, INTERRUPTED, RUNNING
from tlr_exp.records.extending import complete_extension
from tlr_exp.records.run_directory import RunDirectory
from tlr_exp.records.runs import find_or_create_run, next_run_path
from tlr_exp.records.storage import StorageError

if TYPE_CHECKING:
    from tlr_exp.motion.clip import MotionClip
    from tlr_exp.optimizer.protocol import WeightOptimizer
    from tlr_exp.reward.objectives import Objective
    from tlr_exp.robot.model import Robot
    from tlr_exp.training.loop import Outcome


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
            raise UserError("credentials belong in the variable MLFLOW_TRACKING_URI, not here")
        return check_tracking_uri(settings.tracking_uri)
    except ValueError as error:
        raise ConfigError(f"tracking_uri: {error}") from error


def check_inputs(settings: Settings) -> Parts:
    """Try what the configuration names, before a run directory is made; what was built thereby.

    Raises:
        ConfigError: see `check_world`, `check_lower_layer` and `check_beginning`.
    """
    robot, clip = check_world(settings)
    objective, weight_optimizer = check_lower_layer(settings)
    check_beginning(settings)
    return Parts(robot, clip, objective, weight_optimizer)


def check_world(settings: Settings, device: bool = True) -> tuple[Robot, MotionClip]:
    """The model and the motion, read; and look at the engine's settings, and for the device.

    Without ``device`` that is left out, for a machine that only hands work to others.

    Raises:
        ConfigError: a model that is not a G1, a motion that cannot be, an engine that refuses its
            settings, or a device that is away.
    """
    from tlr_exp.assembly.world import build_clip, build_robot_of, num_starts

    try:
        robot = build_robot_of(settings.env)
        clip = build_clip(settings.env, robot)
    except ValueError as error:
        raise ConfigError(str(error)) from error
    if settings.env.reference_lead + 2 > clip.num_frames:
        raise ConfigError(
            f"env.reference_lead is {settings.env.reference_lead}; the motion has only "
            f"{clip.num_frames} frames at the control rate of {clip.fps:g} Hz, and "
            f"{settings.env.reference_lead + 2} are needed"
        )
    try:
        starts = settings.scale.evaluate_starts
        check_starts("scale.evaluate_starts", starts, num_starts(settings.env, clip))
    except ValueError as error:
        raise ConfigError(str(error)) from error
    places = {"robot": robot, "num_envs": settings.scale.num_envs, "device": settings.device}
    check_component("physics", settings.physics, **places)
    if any(value is not None for value in vars(settings.env.disturbance).values()):
        from tlr_exp.assembly.environment import check_disturbance

        check_disturbance(settings)
    if device and settings.device != "cpu":
        from tlr_exp.assembly.learner import check_device

        check_device(settings.device)
    return robot, clip


def check_lower_layer(settings: Settings) -> tuple[Objective, WeightOptimizer]:
    """The objective and the weight optimizer, which check their settings themselves.

    The objective is tried on returns of as many trajectories as an iteration has.

    Raises:
        ConfigError: one of them refuses its settings, or lacks a package.
    """
    import torch

    from tlr_exp.assembly.lower_layer import build_lower_layer

    objective, weight_optimizer = build_lower_layer(settings)
    num_envs, num_terms = settings.scale.num_envs, len(settings.reward.optimizing)
    try:
        objective.prepare(torch.arange(num_envs) / num_envs, torch.zeros(num_envs, num_terms))
    except ValueError as error:
        raise ConfigError(f"reward.objective: {error}") from error
    return objective, weight_optimizer


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


def train_in(run: RunDirectory, settings: Settings, parts: Parts, uri: str | None) -> Outcome:
    """Train in ``run``, mirrored to MLflow, and say at the end what there is to look at.

    ``parts`` are what `check_inputs` has built.
    """
    print(f"{run.path.name}: {settings.scale.evidence}", flush=True)
    run.set_status(RUNNING)
    complete_extension(run)
    mirror = Mirror.start(run, uri, settings.study)
    try:
        # Loads PyTorch, TorchRL and MuJoCo, which takes seconds: after all that can be checked.
        from tlr_exp.training.loop import Training

        training = Training(settings, run, parts)
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
