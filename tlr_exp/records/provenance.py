"""Tells what a run is made with: source revision, package versions, machine."""

import os
import platform
import socket
import subprocess
from importlib import metadata
from pathlib import Path

PACKAGES = (
    "torch",
    "torchrl",
    "tensordict",
    "mujoco",
    "mujoco-mjx",
    "jax",
    "numpy",
    "hydra-core",
    "omegaconf",
    "mlflow",
    "scipy",
    "cmaes",
    "mealpy",
)

_GIT_TIMEOUT_S = 5.0


def source_revision() -> dict[str, object] | None:
    """The revision of the code that runs; None for an installed copy, which has a version instead.

    A copy may lie inside another project's work tree: only a file that git tracks tells.
    """
    folder = Path(__file__).parent
    return git_state(folder) if _git(folder, "ls-files", Path(__file__).name) else None


def git_state(folder: Path) -> dict[str, object] | None:
    """Commit and dirty flag of the git work tree that holds `folder`; None where there is none.

    Untracked files do not make it dirty: results usually lie beside the source.
    """
    commit = _git(folder, "rev-parse", "HEAD")
    changes = _git(folder, "status", "--porcelain", "--untracked-files=no")
    if commit is None or changes is None:
        return None
    return {"commit": commit, "dirty": bool(changes)}


def _git(folder: Path, *arguments: str) -> str | None:
    try:
        result = subprocess.run(
            ["git", *arguments],
            cwd=folder,
            capture_output=True,
            text=True,
            timeout=_GIT_TIMEOUT_S,
            check=True,
            # A status must not take the index lock from someone who is committing.
            env={**os.environ, "GIT_OPTIONAL_LOCKS": "0"},
        )
    except (OSError, subprocess.SubprocessError):
        return None
    return result.stdout.strip()


def package_versions(names: tuple[str, ...] = PACKAGES) -> dict[str, str]:
    """Installed versions by distribution name, read without importing; absent ones are left out."""
    versions = {}
    for name in names:
        try:
            versions[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            continue
    return versions


def machine(device: str | None) -> dict[str, object]:
    """Host name, platform, number and model of the processors, and the device trained on."""
    return {
        "host": socket.gethostname(),
        "platform": platform.platform(),
        "cpu_count": os.cpu_count(),
        "cpu_model": _cpu_model(),
        "device": device,
    }


def _cpu_model() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        lines = []
    for line in lines:
        key, _, value = line.partition(":")
        if key.strip() == "model name":
            return value.strip()
    return platform.processor() or platform.machine()
