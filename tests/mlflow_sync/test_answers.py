"""Servers that are no MLflow, or refuse: what they answered is said, and whether to try again."""

import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

import pytest

from tlr_exp.commands.sync import main
from tlr_exp.mlflow_sync.answers import wrong_answer


@contextmanager
def http_server(status: int, body: bytes) -> Iterator[str]:
    """Answers everything alike; its address."""

    class Handler(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            self.rfile.read(int(self.headers.get("Content-Length") or 0))
            self.send_response(status)
            self.send_header("Content-Length", str(len(body)))
            self.end_headers()
            self.wfile.write(body)

        do_POST = do_GET

        def log_message(self, format: str, *args: object) -> None:
            pass

    with ThreadingHTTPServer(("127.0.0.1", 0), Handler) as server:
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        yield f"http://127.0.0.1:{server.server_address[1]}"
        server.shutdown()
        thread.join()


@contextmanager
def raw_server(text: bytes) -> Iterator[str]:
    """Says one thing, whatever it is asked, and closes."""
    with socket.create_server(("127.0.0.1", 0)) as listening:

        def serve() -> None:
            while True:
                try:
                    connection, _ = listening.accept()
                except OSError:
                    return
                with connection:
                    connection.recv(1000)
                    connection.sendall(text)

        thread = threading.Thread(target=serve)
        thread.start()
        yield f"http://127.0.0.1:{listening.getsockname()[1]}"
        listening.shutdown(socket.SHUT_RDWR)
    thread.join()


@pytest.mark.parametrize(
    ("status", "body", "words", "passing"),
    [
        (200, b"<!DOCTYPE html>\n<p>", "it answered 200 '<!DOCTYPE html>', which no MLflow", False),
        (200, b"", "it answered 200 and no text, which no MLflow", False),
        (200, b'{"a": 1}', "it answered 200 '{\"a\": 1}', which no MLflow", False),
        (200, b"[1]", "it answered 200 '[1]', which no MLflow", False),
        (
            200,
            b"\x00\x01\xff",
            "it answered 200 '???', which no MLflow".replace("???", "??�"),
            False,
        ),
        (404, b"nothing here", "it answered 404 'nothing here', which no MLflow", False),
        (401, b"who?", "it refuses the user name or the password (it answered 401 'who?')", False),
        (403, b"no", "it does not allow this user to (it answered 403 'no')", False),
        (502, b"<html>bad", "it answered 502 '<html>bad'", True),
    ],
)
def test_wrong_answers(status, body, words, passing):
    with http_server(status, body) as uri:
        found = wrong_answer(uri)
    assert found is not None
    assert found.words.startswith(words)
    assert found.passing == passing


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (b"SSH-2.0-OpenSSH_9.2\r\n", "no HTTP server is there; it said 'SSH-2.0-OpenSSH_9.2'"),
        (b"", "it closed the connection without an answer"),
    ],
)
def test_what_is_no_http(text, words):
    with raw_server(text) as uri:
        found = wrong_answer(uri)
    assert found is not None
    assert found.words.startswith(words)


@pytest.mark.parametrize(
    "body", [b"{}", b'{"experiments": []}', b'{"experiments": [' + b" " * 9999]
)
def test_mlflows_answers_are_right(body):
    with http_server(200, body) as uri:
        assert wrong_answer(uri) is None
    assert wrong_answer(uri) is None  # nobody is there, which the refused connection says
    assert wrong_answer("sqlite:///mlflow.db") is None


@pytest.mark.parametrize(
    ("status", "body", "advice"),
    [(200, b"<p>hello", "Once that is fixed"), (503, b"later", "Later, repeat")],
)
def test_tlr_sync_says_what_answered_and_no_password(run, capsys, status, body, advice):
    with http_server(status, body) as uri:
        given = uri.replace("http://", "http://me:s3cret@")
        assert main([str(run.path), "--tracking-uri", given]) == 1
    error = capsys.readouterr().err
    assert f"MLflow at {uri}: it answered {status} '{body.decode()}'" in error
    assert advice in error
    assert "s3cret" not in error
