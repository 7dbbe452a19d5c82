"""The one command that repeats a study, from the commands of its runs."""

import shlex
from collections.abc import Sequence
from itertools import product

_PROGRAMS = {"train.py": "tlr-train"}  # as the command calls itself where it is run as a file


def one_command(commands: Sequence[str]) -> str:
    """The sweep that starts the same runs as ``commands`` do; empty where no one command does.

    Overrides in which the commands differ become lists, "seed=0,1,2", if the commands are every
    combination of their values. Of commands that are all the same, that one.
    """
    split = [_words(command) for command in dict.fromkeys(commands)]
    if not split or any(words is None for words in split):
        return ""
    programs, overrides = zip(*filter(None, split), strict=True)
    names = [list(each) for each in overrides]
    if len(set(programs)) > 1 or any(each != names[0] for each in names):
        return ""
    if len(split) == 1:
        return commands[0]
    values = {name: [*dict.fromkeys(each[name] for each in overrides)] for name in names[0]}
    made = {tuple(each.values()) for each in overrides}
    if made != set(product(*values.values())):
        return ""
    words = [f"{name}={','.join(each)}" for name, each in values.items()]
    return shlex.join([*shlex.split(programs[0]), "-m", *words])


def _words(command: str) -> tuple[str, dict[str, str]] | None:
    """Program (with its flags) and overrides of a command; None where it is not of that form."""
    try:
        first, *rest = shlex.split(command)
    except ValueError:
        return None
    flags = [word for word in rest if word.startswith("-")]
    pairs = [word.partition("=") for word in rest if not word.startswith("-")]
    if any(not equals for _, equals, _ in pairs) or len({name for name, _, _ in pairs}) < len(
        pairs
    ):
        return None
    program = shlex.join([_PROGRAMS.get(first, first), *flags])
    return program, {name: value for name, _, value in pairs}
