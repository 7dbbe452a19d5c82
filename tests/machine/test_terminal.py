"""No locale, terminal or path ends a command: what cannot be shown is replaced."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from tlr_exp.machine.terminal import refuse_without_docstrings, show_any_text
from tlr_exp.motion.clip import MotionClip

ENCODINGS = ("ascii:strict", "latin-1:strict", "utf-8:strict")


def run(*command: str | bytes, encoding: str) -> subprocess.CompletedProcess[bytes]:
    environment = {**os.environ, "PYTHONIOENCODING": encoding, "COLUMNS": "200"}
    return subprocess.run(
        [sys.executable, "-m", *command], env=environment, capture_output=True, timeout=300
    )


@pytest.mark.parametrize("encoding", ENCODINGS)
def test_a_check_shows_signs_that_no_locale_knows(encoding, short_clip_path):
    """Its table has frames, a sign for at-least and squares of seconds."""
    done = run("tlr_exp.commands.motion", "check", str(short_clip_path), encoding=encoding)
    assert b"Traceback" not in done.stderr
    assert done.returncode in (0, 1)
    assert b"joint jump" in done.stdout


@pytest.mark.parametrize("encoding", ENCODINGS)
def test_a_path_that_is_no_text(encoding, tmp_path, short_clip: MotionClip):
    folder = os.fsencode(tmp_path) + b"/bad\xff"
    os.mkdir(folder)
    clip = Path(os.fsdecode(folder)) / "clip.npz"
    short_clip.save(clip)
    output = folder + b"/again.npz"
    done = run(
        "tlr_exp.commands.motion", "import", os.fsencode(clip), "-o", output, encoding=encoding
    )
    assert (done.returncode, done.stderr) == (0, b"")
    assert b"/bad?/clip.npz: tlr, 41 frames" in done.stdout
    assert os.path.exists(output)
    done = run("tlr_exp.commands.motion", "info", folder + b"/absent.npz", encoding=encoding)
    assert done.returncode == 1
    assert b"there is no motion clip" in done.stderr
    assert b"Traceback" not in done.stderr


def test_streams_without_encoding_are_left_alone(monkeypatch):
    written = []

    class Stream:
        def write(self, text: str) -> None:
            written.append(text)

    monkeypatch.setattr(sys, "stdout", Stream())
    show_any_text()
    print("ä")
    assert "ä" in written


def test_without_docstrings_training_is_refused_in_one_line():
    environment = {**os.environ, "PYTHONOPTIMIZE": "2"}
    command = [sys.executable, "-m", "tlr_exp.commands.train", "env=stand"]
    done = subprocess.run(command, env=environment, capture_output=True, timeout=300)
    assert done.returncode == 2
    assert done.stdout == b""
    assert done.stderr.startswith(b"tlr-train: python -OO (PYTHONOPTIMIZE=2) takes out")
    assert done.stderr.count(b"\n") == 1


def test_with_docstrings_nothing_is_refused():
    assert sys.flags.optimize < 2
    refuse_without_docstrings("tlr-train")
