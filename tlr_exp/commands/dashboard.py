"""tlr-dashboard: MLflow's pages on the store of a folder of runs, for this machine alone."""

import argparse
import os
import socket
import sqlite3
import sys
from collections.abc import Sequence
from contextlib import closing
from pathlib import Path
from typing import NoReturn

from tlr_exp.errors import UserError
from tlr_exp.machine.terminal import EXIT_WRONG, add_version, command
from tlr_exp.machine.variables import TRACKING_URI
from tlr_exp.mlflow_sync.tracking_uri import default_tracking_uri, sqlite_path
from tlr_exp.records.credentials import hide_password
from tlr_exp.records.run_directory import RunDirectory

HOST, PORT, PORTS_TRIED = "127.0.0.1", 5000, 20

# One worker and no job queue: MLflow's own defaults are a dozen processes of 250 MB each.
SERVER_OPTIONS = ("--workers", "1", "--uvicorn-opts", "--log-level=warning")
SERVER_ENVIRONMENT = {
    "MLFLOW_SERVER_ENABLE_JOB_EXECUTION": "false",
    "MLFLOW_DISABLE_TELEMETRY": "true",
    "DO_NOT_TRACK": "true",
}


@command("tlr-dashboard", status=EXIT_WRONG)
def main(arguments: Sequence[str] | None = None) -> int:
    """Entry point; becomes the server. 1: there is nothing to show; 2: wrong arguments."""
    options = _parser().parse_args(arguments)
    uri = default_tracking_uri(options.runs_dir)
    if uri.startswith("http"):
        print(f"{TRACKING_URI} names a server that is already running: {hide_password(uri)}")
        return 0
    problem = what_is_missing(uri, options.runs_dir)
    if problem is not None:
        print(problem, file=sys.stderr)
        return 1
    port = free_port(options.port)
    print(f"{hide_password(uri)} in MLflow, in a few seconds; Ctrl-C stops it\n")
    print("\n".join(pages(uri, port)), flush=True)
    return _become_the_server(uri, port)


def _become_the_server(uri: str, port: int) -> NoReturn:
    # The URI goes by the environment: it may hold a password, and command lines are public.
    environment = {**os.environ, **SERVER_ENVIRONMENT, "MLFLOW_BACKEND_STORE_URI": uri}
    os.execve(sys.executable, server_command(port), environment)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="tlr-dashboard",
        description="Serve MLflow's pages for a folder of runs, on this machine only.",
    )
    add_version(parser)
    parser.add_argument(
        "runs_dir",
        nargs="?",
        default=Path("runs"),
        type=Path,
        help=f"the folder that holds the store (default: runs; {TRACKING_URI} takes precedence)",
    )
    parser.add_argument(
        "--port", type=int, help=f"port to serve on (default: the first free one from {PORT})"
    )
    return parser


def what_is_missing(uri: str, runs_dir: Path) -> str | None:
    """Why there is nothing to show in the store at `uri`, and what to do; None if there is."""
    database = sqlite_path(uri)
    if database is None or (database.is_file() and database.stat().st_size > 0):
        return None
    if runs_dir.is_dir() and RunDirectory.find(runs_dir):
        todo = f"To copy the runs in {runs_dir} to it:  tlr-sync {runs_dir}"
    else:
        todo = "Train first, with `make train` or tlr-train, or name the folder of your runs."
    return f"there is no MLflow store {database} yet. {todo}"


def free_port(wanted: int | None) -> int:
    """The port to serve on: the one wanted, else the first free one from 5000 on.

    Raises:
        UserError: the one wanted is in use, or all that were tried are.
    """
    candidates = range(PORT, PORT + PORTS_TRIED) if wanted is None else [wanted]
    for port in candidates:
        with socket.socket() as attempt:
            # As the server will: a port whose last connections are still closing is free.
            attempt.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            try:
                attempt.bind((HOST, port))
            except (OSError, OverflowError):
                continue
            return port
    if wanted is None:
        raise UserError(f"the ports {PORT} to {PORT + PORTS_TRIED - 1} are all in use; give --port")
    raise UserError(f"port {wanted} is in use or not allowed; without --port a free one is found")


def pages(uri: str, port: int) -> list[str]:
    """Lines with the addresses of the studies: the list of final numbers, and the curves."""
    from tlr_exp.mlflow_sync.experiment_page import CURVES_QUERY, NUMBERS_QUERY

    address = f"http://{HOST}:{port}"
    database = sqlite_path(uri)
    if database is None:
        return [f"  {address}"]
    query = (
        "SELECT name, experiment_id FROM experiments WHERE lifecycle_stage = 'active' "
        "AND experiment_id IN (SELECT experiment_id FROM runs) ORDER BY name"
    )
    try:
        with closing(sqlite3.connect(f"{database.as_uri()}?mode=ro", uri=True)) as connection:
            studies = connection.execute(query).fetchall()
    except sqlite3.Error:  # MLflow will say what is wrong with it
        studies = []
    lines = []
    for name, number in studies:
        runs = f"{address}/#/experiments/{number}/runs"
        lines += [
            f"  {name}",
            f"    runs    {runs}{NUMBERS_QUERY}",
            f"    curves  {runs}{CURVES_QUERY}",
        ]
    return lines or [f"  {address}"]


def server_command(port: int) -> list[str]:
    """The command line of the server, which listens on loopback alone."""
    serve = [sys.executable, "-m", "mlflow", "server"]
    return [*serve, "--host", HOST, "--port", str(port), *SERVER_OPTIONS]


if __name__ == "__main__":
    sys.exit(main())
