"""Checks the URI of an MLflow store, and finds one where none is given."""

from pathlib import Path
from urllib.parse import urlsplit

from tlr_exp.errors import UserError
from tlr_exp.machine import variables
from tlr_exp.records.credentials import hide_password

STORE = "mlflow.db"

_SQLITE = "sqlite:///"
_SCHEMES = ("http", "https", "sqlite", "postgresql", "mysql", "mssql")


def default_tracking_uri(root: str | Path) -> str:
    """MLFLOW_TRACKING_URI where it is set, else the sqlite store mlflow.db in `root`.

    Raises:
        UserError: the variable holds something that cannot be used (see `check_tracking_uri`).
    """
    from_environment = variables.tracking_uri()
    if from_environment:
        return check_tracking_uri(from_environment)
    return f"{_SQLITE}{Path(root).absolute() / STORE}"


def check_tracking_uri(uri: str) -> str:
    """`uri` with a sqlite path made absolute, because the mirror runs in another folder.

    Raises:
        UserError: not a kind of store that MLflow 3 can write to; names the kinds.
    """
    scheme = urlsplit(uri).scheme.partition("+")[0]
    if scheme not in _SCHEMES:
        raise UserError(
            f"tracking URI {hide_password(uri)!r}: must be http://HOST:PORT, sqlite:///FILE or "
            f"another of {', '.join(_SCHEMES)} (MLflow no longer writes to plain folders)"
        )
    if scheme != "sqlite":
        return uri
    path = sqlite_path(uri)
    if path is None:
        raise UserError(f"tracking URI {uri!r}: name a file, as in sqlite:///runs/mlflow.db")
    return f"{_SQLITE}{path.absolute()}"


def sqlite_path(uri: str) -> Path | None:
    """The database file of a sqlite URI, None for every other URI and for one in memory."""
    if not uri.startswith(_SQLITE):
        return None
    name = uri.removeprefix(_SQLITE).partition("?")[0]
    return Path(name) if name and name != ":memory:" else None


def how_to_open(uri: str, runs_dir: Path) -> str:
    """For messages: the address of a server, or the command that opens a store."""
    if uri.startswith("http"):
        return hide_password(uri)
    if sqlite_path(uri) == runs_dir / STORE:
        return f"tlr-dashboard {runs_dir}"
    return f"mlflow server --backend-store-uri {hide_password(uri)}"
