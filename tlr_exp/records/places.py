"""Texts without the places that they name: what is published tells neither people nor machines.

Every path that says where something lies (absolute, in a home, above the current folder, on
another drive) keeps its last part alone, and every address of a server its kind alone. Relative
paths, names of runs and studies, versions and times stay.
"""

import re
import shlex
from collections.abc import Mapping
from typing import Any

HOME, HOST = "HOME", "HOST"

# An address, or a path behind the start of a text or what separates values on a command line.
_ADDRESS = r"(?P<scheme>[A-Za-z][A-Za-z0-9+.-]*)://(?P<rest>[^\s,\])'\"]*)"
_PATH = (
    r"(?:(?<=^)|(?<=[\s=,:;\[({'\"]))"
    r"(?:~|\.\.(?=/)|(?=/)|[A-Za-z]:(?=[\\/]))[^,;:\])}'\"=]*"
)
_PLACE = re.compile(f"{_ADDRESS}|{_PATH}")
_OF_FILES = ("file", "sqlite", "pkg")  # schemes whose rest is a path
_HOMES = re.compile(r"^(?:~[^/]*|(?:[A-Za-z]:)?[\\/](?:home|Users)[\\/][^\\/]+|/root)[\\/]*$")


def plain_command(command: str) -> str:
    """A command line with every path and address shortened."""
    try:
        words = shlex.split(command)
    except ValueError:  # not of a shell; cut at spaces
        words = command.split()
    return shlex.join(plain_text(word) for word in words)


def plain_values(value: Any) -> Any:
    """A configuration with the paths and addresses in its texts shortened."""
    if isinstance(value, Mapping):
        return {name: plain_values(item) for name, item in value.items()}
    if isinstance(value, list):
        return [plain_values(item) for item in value]
    return plain_text(value) if isinstance(value, str) else value


def plain_text(text: str) -> str:
    """One value or word with the paths and addresses in it shortened.

    "env.motion=/home/ann/clips/walk.yaml" becomes "env.motion=walk.yaml", "http://ann@host:5000"
    becomes "http://HOST", and a home itself HOME.
    """
    return _PLACE.sub(_shortened, text)


def last_part(path: str) -> str:
    """The last part of a path, HOME where that is somebody's."""
    if _HOMES.match(path):
        return HOME
    return re.split(r"[\\/]", path.rstrip("\\/ "))[-1] or "/"


def _shortened(found: re.Match[str]) -> str:
    scheme = found["scheme"]
    if scheme is None:
        return last_part(found.group())
    if scheme in _OF_FILES:
        return f"{scheme}://{'/' if scheme == 'sqlite' else ''}{last_part(found['rest'])}"
    return f"{scheme}://{HOST}"
