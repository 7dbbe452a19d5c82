"""How every command begins and ends: its version, what it tells of errors, and its exit status."""

import subprocess
import sys
import tomllib
from importlib import import_module
from pathlib import Path

import pytest

import tlr_exp
from tlr_exp.errors import UserError
from tlr_exp.machine.terminal import command, print_error
from tlr_exp.records.storage import StorageError

ROOT = Path(__file__).parents[2]
COMMANDS = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"][
    "scripts"
]


class WrongError(UserError):
    """What the command of the tests calls wrong arguments."""


def ending(error: BaseException | None) -> int:
    """The exit status of a command that ends with an error, or as it should."""

    @command("tlr-test", status=1, wrong=(WrongError,))
    def main() -> None:
        if error is not None:
            raise error

    return main()


@pytest.mark.parametrize(
    ("error", "status", "told"),
    [
        (None, 0, ""),
        (UserError("no such thing"), 1, "tlr-test: no such thing\n"),
        (WrongError("not so"), 2, "tlr-test: not so\n"),
        (FileNotFoundError(2, "No such file", "x"), 1, "tlr-test: [Errno 2] No such file: 'x'\n"),
        (KeyboardInterrupt(), 130, "tlr-test: interrupted\n"),
    ],
)
def test_what_is_explained_is_told_without_a_traceback(error, status, told, capsys):
    assert ending(error) == status
    assert capsys.readouterr().err == told


@pytest.mark.parametrize("error", [TypeError("a bug"), ValueError("a bug"), KeyError("a bug")])
def test_a_fault_of_the_program_is_passed_on(error, capsys):
    with pytest.raises(type(error)):
        ending(error)
    print_error(error)
    assert "Traceback" in capsys.readouterr().err


def test_a_disk_that_is_full_is_explained_and_still_an_error_of_the_system():
    error = StorageError("cannot write x", OSError(28, "No space left on device"), "Make room")
    assert isinstance(error, UserError)
    assert isinstance(error, OSError)
    assert (str(error), error.errno) == (
        "cannot write x: No space left on device. Make room",
        28,
    )


@pytest.mark.parametrize("name", sorted(set(COMMANDS) - {"tlr-train"}))
def test_every_command_tells_its_version(name, capsys):
    module, function = COMMANDS[name].split(":")
    with pytest.raises(SystemExit) as left:
        getattr(import_module(module), function)(["--version"])
    assert left.value.code == 0
    assert capsys.readouterr().out == f"{name} {tlr_exp.__version__}\n"


def test_training_tells_its_own_version_and_not_that_of_hydra():
    line = [sys.executable, "-m", "tlr_exp.commands.train", "--version"]
    done = subprocess.run(line, capture_output=True, text=True, cwd=ROOT)
    assert (done.returncode, done.stdout) == (0, f"tlr-train {tlr_exp.__version__}\n")
