"""What a run was made with: the state of a git work tree, versions, the machine."""

import subprocess
from pathlib import Path

import pytest

from tlr_exp.records.provenance import git_state, machine, package_versions


def test_git_state(tmp_path: Path) -> None:
    assert git_state(tmp_path) is None
    assert git_state(tmp_path / "missing") is None

    def git(*arguments: str) -> str:
        identity = ["-c", "user.name=n", "-c", "user.email=e@example.org"]
        command = ["git", *identity, *arguments]
        return subprocess.run(
            command, cwd=tmp_path, check=True, capture_output=True, text=True
        ).stdout.strip()

    git("init", "--quiet")
    assert git_state(tmp_path) is None  # no commit yet
    (tmp_path / "a").write_text("1")
    git("add", "a")
    git("commit", "--quiet", "-m", "first")
    (tmp_path / "untracked").write_text("")
    assert git_state(tmp_path) == {"commit": git("rev-parse", "HEAD"), "dirty": False}
    (tmp_path / "a").write_text("2")
    assert git_state(tmp_path) == {"commit": git("rev-parse", "HEAD"), "dirty": True}


def test_versions_and_machine() -> None:
    versions = package_versions(("pytest", "no-such-distribution"))
    assert versions == {"pytest": pytest.__version__}
    assert machine("cuda:0")["device"] == "cuda:0"
    assert machine(None)["cpu_model"]
