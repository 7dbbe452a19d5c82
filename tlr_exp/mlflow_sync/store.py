"""Opening an MLflow store so that it neither talks, nor waits for minutes, nor breaks.

The one file that imports mlflow; the names it needs elsewhere are passed on from here.
"""

import logging
import os
import re
import sqlite3
import time
import warnings
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path

from sqlalchemy.exc import SQLAlchemyError

from tlr_exp.errors import UserError
from tlr_exp.mlflow_sync.answers import PASSWORD_VARIABLE, USER_VARIABLE, wrong_answer
from tlr_exp.mlflow_sync.experiment_page import experiment_tags
from tlr_exp.mlflow_sync.tracking_uri import sqlite_path
from tlr_exp.records.credentials import hide_password, scrub, split_credentials
from tlr_exp.records.directory import ARTIFACTS
from tlr_exp.records.locks import hold_where_possible

# Before mlflow is imported: no usage reports, no log set-up of its own, and a server that is away
# is noticed in seconds (MLflow's own limits add up to many minutes).
for _name, _value in {
    "MLFLOW_DISABLE_TELEMETRY": "true",
    "DO_NOT_TRACK": "true",
    "MLFLOW_CONFIGURE_LOGGING": "false",
    "MLFLOW_ENABLE_ARTIFACTS_PROGRESS_BAR": "false",
    "MLFLOW_HTTP_REQUEST_MAX_RETRIES": "1",
    "MLFLOW_HTTP_REQUEST_BACKOFF_FACTOR": "1",
    "MLFLOW_HTTP_REQUEST_TIMEOUT": "10",
    "MLFLOW_SUPPRESS_PRINTING_URL_TO_STDOUT": "true",
    "GIT_PYTHON_REFRESH": "quiet",
}.items():
    os.environ.setdefault(_name, _value)

with warnings.catch_warnings():  # what MLflow does with its own libraries is not ours to hear
    warnings.simplefilter("ignore")
    from mlflow.entities import Metric, Param, Run, RunTag
    from mlflow.exceptions import MlflowException
    from mlflow.store.tracking.sqlalchemy_store import SqlAlchemyStore
    from mlflow.tracking import MlflowClient

__all__ = [
    "Metric",
    "MlflowClient",
    "MlflowException",
    "Param",
    "Run",
    "RunTag",
    "TrackingError",
    "TrackingUnavailable",
    "experiment_id",
    "open_client",
    "tracking_errors",
]

MAKING_WAIT_S = 60.0  # for another process that makes the same store
SQLITE_WAIT_S = 20.0  # for someone's transaction on the database; MLflow's own wait is the same

# Codes with which another try may succeed; a request that got no answer has INTERNAL_ERROR.
_PASSING = (
    "INTERNAL_ERROR",
    "TEMPORARILY_UNAVAILABLE",
    "REQUEST_LIMIT_EXCEEDED",
    "RESOURCE_EXHAUSTED",
    "DEADLINE_EXCEEDED",
    "ABORTED",
)

for _name in ("mlflow", "alembic"):  # the errors that matter reach us as exceptions
    logging.getLogger(_name).setLevel(logging.CRITICAL)


class TrackingError(UserError):
    """MLflow refuses the run; trying again without a change will not help."""


class TrackingUnavailable(TrackingError):
    """The store is away, locked or full: nothing is lost, try again later."""


@contextmanager
def tracking_errors(uri: str) -> Iterator[None]:
    """Turn the errors of MLflow, its database and its files into the two above, in one line."""
    place = hide_password(uri)
    try:
        yield
    except TrackingError:
        raise
    except MlflowException as error:
        # What MLflow says of a server that is none names neither its answer nor what to do.
        answer = wrong_answer(uri)
        passing = error.error_code in _PASSING if answer is None else answer.passing
        words = scrub(_one_line(error), uri) if answer is None else answer.words
        kind = TrackingUnavailable if passing else TrackingError
        raise kind(f"MLflow at {place}: {words}") from error
    except (OSError, SQLAlchemyError, sqlite3.Error) as error:
        words = scrub(_one_line(error), uri)
        raise TrackingUnavailable(f"MLflow at {place}: {words}") from error


def open_client(uri: str) -> MlflowClient:
    """A client of the store at `uri`; a sqlite store that is not there yet is made.

    Raises:
        TrackingUnavailable: the store is away, locked, or cannot be made.
        TrackingError: the file is no database, or MLflow of another version wrote it.
    """
    database = sqlite_path(uri)
    with tracking_errors(uri):
        if database is None:
            client = MlflowClient(tracking_uri=_without_credentials(uri))
            # So that a server that is away shows here, and one that has no experiment or is none.
            if not client.search_experiments(max_results=1):
                _require_mlflow(uri)
            return client
        database.parent.mkdir(parents=True, exist_ok=True)
        # Processes that open a new store together run MLflow's migrations into each other.
        with hold_where_possible(Path(f"{database}.lock"), _being_made, MAKING_WAIT_S):
            if database.exists() and database.stat().st_size > 0:
                _require_readable(database)
            else:
                _make_store(database)
            return MlflowClient(tracking_uri=uri)


def _being_made() -> TrackingError:
    return TrackingUnavailable("another process is making the store")


def _without_credentials(uri: str) -> str:
    """The URI for MLflow, which prints it and sends it on; it takes the password by variables."""
    address, given = split_credentials(uri)
    if given is not None:
        os.environ[USER_VARIABLE], os.environ[PASSWORD_VARIABLE] = given.user, given.password
    return address


def _require_mlflow(uri: str) -> None:
    if answer := wrong_answer(uri):
        raise TrackingError(f"MLflow at {hide_password(uri)}: {answer.words}")


def experiment_id(client: MlflowClient, name: str, uri: str) -> str:
    """The id of the experiment called `name`, which is made where there is none.

    Raises:
        TrackingError: it was deleted in MLflow and not yet purged.
    """
    found = client.get_experiment_by_name(name)
    if found is None:
        database = sqlite_path(uri)
        # Without a location a local store would put files into ./mlruns of whoever calls.
        location = None if database is None else _artifact_root(database)
        try:
            tags = experiment_tags(int(time.time() * 1000))
            return client.create_experiment(name, artifact_location=location, tags=tags)
        except MlflowException:  # another process was faster
            found = client.get_experiment_by_name(name)
            if found is None:
                raise
    if found.lifecycle_stage != "active":
        raise TrackingError(
            f"the MLflow experiment {name!r} was deleted: restore it (mlflow experiments restore "
            f"--experiment-id {found.experiment_id}) or give another name"
        )
    return found.experiment_id


def _make_store(database: Path) -> None:
    """Make an empty store under another name and rename it: a kill cannot leave half of one."""
    unfinished = database.with_name(f".{database.name}.new")
    for rest in unfinished.parent.glob(f"{unfinished.name}*"):
        rest.unlink()
    store = SqlAlchemyStore(f"sqlite:///{unfinished}", _artifact_root(database))
    store.engine.dispose()
    os.replace(unfinished, database)


def _require_readable(database: Path) -> None:
    """Wait out a short lock here; MLflow's own opening of a locked file takes minutes to give up.

    Raises:
        TrackingUnavailable: still locked after SQLITE_WAIT_S.
        TrackingError: not a database.
    """
    try:
        with closing(sqlite3.connect(database, timeout=SQLITE_WAIT_S)) as connection:
            connection.execute("SELECT count(*) FROM sqlite_master")
    except sqlite3.OperationalError:
        raise
    except sqlite3.DatabaseError as error:
        raise TrackingError(f"{database} is no MLflow database: {error}") from error


def _artifact_root(database: Path) -> str:
    return (database.absolute().parent / ARTIFACTS).as_uri()


def _one_line(error: Exception) -> str:
    """The reason at the heart of MLflow's long, nested messages, at most 300 characters."""
    text = str(error)
    for pattern in (r"\[Errno -?\d+\] ([^'\")]+)", r"\(sqlite3\.\w+\) ([^\n]+)"):
        if found := re.search(pattern, text):
            return found.group(1).strip()
    return text.strip().partition("\n")[0][:300] or type(error).__name__
