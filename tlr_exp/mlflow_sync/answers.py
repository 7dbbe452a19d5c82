"""Reads what answers at the address of a tracking server that is none, or that refuses us."""

import http.client
import json
import os
import urllib.error
import urllib.request
from base64 import b64encode
from dataclasses import dataclass

from tlr_exp.records.credentials import split_credentials

# What every MLflow server answers, with these keys at most.
QUESTION = "/api/2.0/mlflow/experiments/search?max_results=1"
_KEYS = {"experiments", "next_page_token"}
_READ = 4096  # bytes of an answer
_SHOWN = 80  # characters of its first line
_BUSY = {408, 425, 429}

USER_VARIABLE, PASSWORD_VARIABLE = "MLFLOW_TRACKING_USERNAME", "MLFLOW_TRACKING_PASSWORD"
TOKEN_VARIABLE = "MLFLOW_TRACKING_TOKEN"


@dataclass(frozen=True)
class WrongAnswer:
    """What is wrong with what a server said, and whether another try may succeed."""

    words: str
    passing: bool


def wrong_answer(uri: str) -> WrongAnswer | None:
    """Ask what every MLflow server answers; None where the answer is right, or there is none."""
    if not uri.startswith("http"):
        return None
    try:
        status, body = _ask(uri)
    except http.client.RemoteDisconnected:
        return WrongAnswer("it closed the connection without an answer", True)
    except http.client.HTTPException as error:
        said = _shown(str(error).encode())
        return WrongAnswer(f"no HTTP server is there; it said {said}: check the port", False)
    except (OSError, ValueError):
        return None  # nobody is there, which needs no further words
    return _judge(status, body)


def _judge(status: int, body: bytes) -> WrongAnswer | None:
    said = f"it answered {status} {_shown(body)}"
    if status == 401:
        return WrongAnswer(
            f"it refuses the user name or the password ({said}): see {USER_VARIABLE} and "
            f"{PASSWORD_VARIABLE}, or those in the URI",
            False,
        )
    if status == 403:
        return WrongAnswer(f"it does not allow this user to ({said})", False)
    if status >= 500 or status in _BUSY:
        return WrongAnswer(said, True)
    if status == 200 and _is_mlflows(body):
        return None
    return WrongAnswer(f"{said}, which no MLflow server does: check the address", False)


def _ask(uri: str) -> tuple[int, bytes]:
    address, given = split_credentials(uri)
    user = given.user if given else os.environ.get(USER_VARIABLE, "")
    password = given.password if given else os.environ.get(PASSWORD_VARIABLE, "")
    request = urllib.request.Request(address.rstrip("/") + QUESTION)
    if user:
        token = b64encode(f"{user}:{password}".encode()).decode()
        request.add_unredirected_header("Authorization", f"Basic {token}")
    elif token := os.environ.get(TOKEN_VARIABLE):
        request.add_unredirected_header("Authorization", f"Bearer {token}")
    timeout_s = float(os.environ.get("MLFLOW_HTTP_REQUEST_TIMEOUT", "10"))
    try:
        with urllib.request.urlopen(request, timeout=timeout_s) as answer:
            return answer.status, answer.read(_READ)
    except urllib.error.HTTPError as error:
        with error:
            return error.code, error.read(_READ)
    except urllib.error.URLError as error:
        if isinstance(error.reason, OSError):
            raise error.reason from error
        raise


def _is_mlflows(body: bytes) -> bool:
    try:
        answer = json.loads(body)
    except ValueError:
        # Longer than what was read of it.
        return len(body) == _READ and body.lstrip().startswith(b"{")
    return isinstance(answer, dict) and set(answer) <= _KEYS


def _shown(body: bytes) -> str:
    text = body.decode("utf-8", errors="replace").strip()
    line = text.partition("\n")[0][:_SHOWN]
    return repr("".join(c if c.isprintable() else "?" for c in line)) if line else "and no text"
