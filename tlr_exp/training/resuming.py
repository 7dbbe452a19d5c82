"""``resume=RUN``: which run continues, and what else a command may set."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from tlr_exp.config.identity import NOT_IDENTITY, run_identity
from tlr_exp.config.input_files import INITIAL, MODEL, MOTION, file_hashes
from tlr_exp.config.limits import RESUME_MODES
from tlr_exp.config.load import ConfigError, load_settings
from tlr_exp.config.nested import value_at, with_value
from tlr_exp.config.past_runs import check_files, configuration_of, with_kept_motion
from tlr_exp.config.settings import Settings
from tlr_exp.config.words import WORDS
from tlr_exp.mlflow_sync.sources import store_of
from tlr_exp.records.checkpoint_files import CHECKPOINTS, checkpoint_iterations
from tlr_exp.records.directory import FINISHED
from tlr_exp.records.extending import ITERATIONS, extend, extensions, total_iterations
from tlr_exp.records.run_directory import POLICY, RunDirectory, RunDirectoryError
from tlr_exp.records.runs import config_hash

# What says where a new run is made; a run that is there stays where it is.
_PLACE = ("runs_dir", "study")
# A word for values alone would say of the run what it is not.
_MAY_CHANGE = tuple(key for key in NOT_IDENTITY if key not in ("resume", *WORDS, *_PLACE))


class FinishedError(RunDirectoryError):
    """The run has all of its iterations; the message says how to get more."""


@dataclass(frozen=True)
class Resumption:
    """A run to go on with, as checked.

    Attributes:
        run: its lock is held by the caller.
        settings: of its own configuration, with what the command changes.
        config: the plain configuration behind them, on the run's own files.
        done: iterations that are in its newest checkpoint.
    """

    run: RunDirectory
    settings: Settings
    config: dict[str, Any]
    done: int

    def record(self) -> None:
        """Write down that the run is trained further than before, if it is.

        Its identity becomes that of a run of the new length, which would learn the same, unless
        its learning rate has fallen towards the former end and rises again: then one of its own.

        Raises:
            StorageError: the run directory cannot be written.
        """
        total = self.settings.scale.iterations
        if total == total_iterations(self.run):
            return
        hashes = self.run.manifest.get("files") or file_hashes(self.config)
        identity = run_identity(self.config, hashes)
        if self.settings.ppo.final_learning_rate is not None:
            before = [entry["from_iteration"] for entry in extensions(self.run.manifest)]
            identity = config_hash({"length": identity, "extended_from": [*before, self.done]})
        extend(self.run, total, self.done, identity)


def is_run(resume: str) -> bool:
    """True if the value of ``resume`` names a run and is not one of its words."""
    return resume not in RESUME_MODES


def run_to_resume(path: str) -> RunDirectory:
    """The run that ``resume`` names.

    Raises:
        RunDirectoryError: there is none, or a policy alone; says what else ``resume`` takes.
    """
    try:
        run = RunDirectory.open(path)
    except RunDirectoryError as error:
        words = ", ".join(RESUME_MODES)
        raise RunDirectoryError(f"resume: {error} Besides a run, resume takes {words}") from error
    if POLICY in run.manifest:
        raise RunDirectoryError(
            f"{run.path} holds a policy alone, which cannot be trained further; begin a new run "
            f"with it by {INITIAL}={path}"
        )
    return run


def resumption(run: RunDirectory, keys: Sequence[str], asked: Mapping[str, Any]) -> Resumption:
    """Check that the run can be gone on with, and what the command says besides.

    Args:
        run: locked by the caller.
        keys: what the command overrides.
        asked: the configuration that it thereby has, plain.

    Raises:
        FinishedError: there is nothing left to train.
        RunDirectoryError: it has no checkpoint to be trained further from.
        ConfigError: the command asks for what the run is not, or the run cannot be built here; or
            a file that the run needs has changed or is gone.
    """
    config = configuration_of(run)
    total = total_iterations(run)
    config = with_value(config, ITERATIONS, total)
    changes = {key: value_at(asked, key) for key in _changed(keys, asked, config)}
    _check_changes(run, changes, config)
    done = max([0, *checkpoint_iterations(run.path / CHECKPOINTS)])
    _check_length(run, changes.get(ITERATIONS, total), total, done)
    config = with_kept_motion(run, config)
    for key, value in changes.items():
        config = with_value(config, key, value)
    settings = load_settings(config)
    try:
        check_files(run, config, (MOTION, MODEL) if done else (MOTION, MODEL, INITIAL))
    except ValueError as error:
        raise ConfigError(str(error)) from error
    if done:  # what it began with is behind it, and may be gone
        settings.init_from = None
    return Resumption(run, settings, config, done)


def store_of_run(run: RunDirectory) -> str:
    """The MLflow store that a run is mirrored to where its configuration says ``auto``.

    Raises:
        ConfigError: a URI that MLflow cannot use.
    """
    try:
        # Its runs_dir may be relative to another folder, or the run may have been moved.
        return store_of(run, run.path.parent, None)
    except ValueError as error:
        raise ConfigError(f"tracking_uri: {error}") from error


def _changed(
    keys: Sequence[str], asked: Mapping[str, Any], config: Mapping[str, Any]
) -> dict[str, None]:
    """The overridden keys, once each, without those that say what the run's configuration says.

    A whole group, such as ``scale=laptop``, says so, too, where it differs in nothing that is
    learned: the run keeps its own words and number of threads.
    """
    dotted = dict.fromkeys(key.replace("/", ".") for key in keys if key != "resume")
    return dict.fromkeys(
        key
        for key in dotted
        if _learned(key, value_at(asked, key)) != _learned(key, value_at(config, key))
    )


def _learned(key: str, value: Any) -> Any:
    """A value; of a group, its keys that change what is learned."""
    if not isinstance(value, Mapping):
        return value
    inner = {name: f"{key}.{name}" for name in value if f"{key}.{name}" not in NOT_IDENTITY}
    return {name: _learned(dotted, value[name]) for name, dotted in inner.items()}


def _check_changes(
    run: RunDirectory, changes: Mapping[str, Any], config: Mapping[str, Any]
) -> None:
    """
    Raises:
        ConfigError: names the keys that a run that is there cannot take.
    """
    place = [key for key in changes if key in _PLACE]
    if place:
        raise ConfigError(
            f"{', '.join(place)}: resume continues {run.path} where it is; move its folder instead"
        )
    refused = [key for key in changes if key not in (*_MAY_CHANGE, ITERATIONS)]
    if refused:
        raise ConfigError(
            f"resume={run.path} continues that run as it is; start a new one with "
            f"{INITIAL}={run.path} to change {', '.join(refused)}. With resume a command may only "
            f"set {', '.join((ITERATIONS, *_MAY_CHANGE))}"
        )
    unknown = [key for key in changes if value_at(config, key) is None]
    if unknown:
        raise ConfigError(f"{', '.join(unknown)}: the configuration of {run.path} has no such key")


def _check_length(run: RunDirectory, wanted: int, total: int, done: int) -> None:
    """
    Raises:
        FinishedError: it has all of its iterations.
        ConfigError: fewer are wanted than it has.
        RunDirectoryError: it has finished, and its checkpoints are gone.
    """
    finished = run.status == FINISHED
    more = f"tlr-train resume={run.path} {ITERATIONS}=N"
    if finished and wanted == total:
        raise FinishedError(
            f"{run.path} has finished its {total} iterations; train it further by\n"
            f"  {more}     with N above {total}"
        )
    if wanted != total and wanted <= done:
        raise ConfigError(
            f"{ITERATIONS} is {wanted}, but {run.path} has trained {done} iterations already; "
            f"allowed: above {done}"
        )
    if finished and not done:
        raise RunDirectoryError(
            f"{run.path} has finished, and none of its checkpoints is there to continue from"
        )
