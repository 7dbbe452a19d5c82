"""A password for the tracking server: in no file, no output and no upload of a run or a sweep."""

import base64
import shutil
import threading
import urllib.error
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import pytest
from stores import free_port, server, small_run

from tlr_exp.commands.sync import main
from tlr_exp.mlflow_sync.answers import PASSWORD_VARIABLE, USER_VARIABLE
from tlr_exp.mlflow_sync.mirror import Mirror
from tlr_exp.mlflow_sync.store import open_client

USER, PASSWORD = "me", "s3cr3t/p@ss"
ESCAPED = "s3cr3t%2Fp%40ss"
TOKEN = base64.b64encode(f"{USER}:{PASSWORD}".encode()).decode()
SECRETS = (PASSWORD.encode(), ESCAPED.encode(), TOKEN.encode())


@pytest.fixture(autouse=True)
def own_environment(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in (USER_VARIABLE, PASSWORD_VARIABLE, "MLFLOW_TRACKING_URI"):
        monkeypatch.setenv(name, "")  # so that it is as before afterwards
        monkeypatch.delenv(name)


@pytest.fixture(scope="module")
def tracking(made_store, tmp_path_factory) -> Iterator[str]:
    """The address of a tracking server: one for all tests here, because it starts in seconds.

    Its artifacts lie apart from the folder of a test, where they would look like a sweep.
    """
    place = tmp_path_factory.mktemp("server")
    shutil.copy(made_store, place / "mlflow.db")
    with server(place, free_port()) as uri:
        yield uri


@contextmanager
def guarded(behind: str) -> Iterator[tuple[str, list[bytes]]]:
    """A server that asks for the password and passes on; its address, and all it was sent."""
    received: list[bytes] = []

    class Handler(BaseHTTPRequestHandler):
        def _pass_on(self) -> None:
            body = self.rfile.read(int(self.headers.get("Content-Length") or 0))
            given = self.headers["Authorization"]
            if given != f"Basic {TOKEN}":
                self._answer(401, b"You are not authenticated.", "text/plain")
                return
            received.append(self.path.encode() + b"\n" + body)
            kept = {"Content-Type": self.headers.get("Content-Type", "application/json")}
            request = urllib.request.Request(
                behind + self.path, data=body or None, headers=kept, method=self.command
            )
            try:
                with urllib.request.urlopen(request) as answer:
                    kind = answer.headers.get("Content-Type", "text/plain")
                    self._answer(answer.status, answer.read(), kind)
            except urllib.error.HTTPError as error:
                with error:
                    self._answer(error.code, error.read(), error.headers["Content-Type"])

        do_GET = do_POST = do_PUT = do_PATCH = do_DELETE = _pass_on

        def _answer(self, status: int, body: bytes, kind: str) -> None:
            self.send_response(status)
            self.send_header("Content-Type", kind)
            self.send_header("Content-Length", str(len(body)))
            self.end_headers()
            self.wfile.write(body)

        def log_message(self, format: str, *args: object) -> None:
            pass

    with ThreadingHTTPServer(("127.0.0.1", 0), Handler) as proxy:
        thread = threading.Thread(target=proxy.serve_forever)
        thread.start()
        yield f"127.0.0.1:{proxy.server_address[1]}", received
        proxy.shutdown()
        thread.join()


def assert_nowhere(folder: Path, *texts: str | bytes) -> None:
    """None of the ways to write the password is in a file below the folder or in the texts."""
    contents = {str(path): path.read_bytes() for path in folder.rglob("*") if path.is_file()}
    contents |= {
        f"text {i}": t if isinstance(t, bytes) else t.encode() for i, t in enumerate(texts)
    }
    assert contents
    for name, content in contents.items():
        assert not [secret for secret in SECRETS if secret in content], name


def test_a_password_in_the_uri_opens_the_server_and_is_written_nowhere(tmp_path, tracking, capfd):
    run = small_run(tmp_path / "runs" / "a", 3, experiment="guarded")
    with guarded(tracking) as (address, received):
        uri = f"http://{USER}:{ESCAPED}@{address}"
        with run.lock():
            live = Mirror.start(run, uri, "guarded")
            run.set_status("finished")
            assert live.finish(timeout_s=1800)
        assert "mirrored to http://127.0.0.1" in (run.path / "sync.log").read_text()
        assert "guarded" in {each.name for each in open_client(uri).search_experiments()}
    assert received
    printed = capfd.readouterr()
    assert_nowhere(tmp_path / "runs", printed.out, printed.err, live.sync_command, *received)
    assert "--tracking-uri" not in live.sync_command  # the variable has it


def test_a_wrong_password_is_said_at_the_end_and_not_only_in_a_log(tmp_path, capfd):
    run = small_run(tmp_path / "runs" / "a", 3)
    with guarded("http://127.0.0.1:9") as (address, received):
        uri = f"http://{USER}:wrong-{ESCAPED}@{address}"
        with run.lock():
            live = Mirror.start(run, uri, "guarded")
            run.set_status("finished")
            assert not live.finish(timeout_s=1800)
        words = live.what_is_missing
        assert main([str(run.path), "--tracking-uri", uri]) == 1
    assert received == []
    assert words.startswith("not all of it has reached MLflow yet: MLflow at http://127.0.0.1")
    assert "it refuses the user name or the password (it answered 401" in words
    printed = capfd.readouterr()
    assert "it refuses the user name or the password" in printed.err
    assert "Once that is fixed" in printed.err
    assert_nowhere(tmp_path, printed.out, printed.err, words)


def test_a_sweep_writes_prints_and_uploads_no_password(sweeper, tmp_path, tracking):
    short = ("scale.iterations=2", "scale.evaluate_every=2", "optimizer=fixed", "seed=0,1")
    with guarded(tracking) as (address, received):
        sweeper.environment = {"MLFLOW_TRACKING_URI": f"http://{USER}:{ESCAPED}@{address}"}
        status, output = sweeper.run(*short, "tracking_uri=auto")
    assert status == 0, output
    sent = b"".join(received)
    assert all(run.manifest["run_id"].encode() in sent for run in sweeper.runs)
    assert sweeper.sweep.manifest["run_id"].encode() in sent
    assert_nowhere(tmp_path, output, *received)
