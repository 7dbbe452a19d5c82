"""Keeps which element of which job array is which job of the sweep: launcher/slurm.json."""

import json
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

from tlr_exp.records.storage import atomic_write
from tlr_exp.records.sweep_directory import SweepDirectoryError
from tlr_exp.sweeps.spec import LAUNCHER_FOLDER

RECORD = "slurm.json"


def record_path(sweep: Path) -> Path:
    """The path of the file in a sweep directory."""
    return sweep / LAUNCHER_FOLDER / RECORD


def read_elements(sweep: Path) -> dict[int, str]:
    """The element of each job that was submitted last, such as ``4711_3``.

    Raises:
        SweepDirectoryError: the record is damaged.
    """
    path = record_path(sweep)
    if not path.exists():
        return {}
    try:
        return {int(num): str(element) for num, element in json.loads(path.read_text()).items()}
    except (OSError, ValueError, AttributeError) as error:
        raise SweepDirectoryError(f"cannot read {path}: {error}") from error


def write_elements(sweep: Path, elements: Mapping[int, str]) -> None:
    """Keep them.

    Raises:
        StorageError: it cannot be written; the old one stays.
    """
    path = record_path(sweep)
    path.parent.mkdir(exist_ok=True)
    atomic_write(path, (json.dumps(dict(sorted(elements.items())), indent=0) + "\n").encode())


def arrays(nums: Iterable[int], size: int) -> dict[int, list[int]]:
    """The job numbers in arrays whose indices are below ``size``, by what index 0 stands for.

    The index of an element is the number of its job, less that.
    """
    split: dict[int, list[int]] = {}
    for num in sorted(nums):
        split.setdefault(num - num % size, []).append(num)
    return split


def index_list(indices: Sequence[int]) -> str:
    """Sorted indices as sbatch and scancel write them: ``0-2,5``."""
    ranges: list[tuple[int, int]] = []
    for index in indices:
        if ranges and index == ranges[-1][1] + 1:
            ranges[-1] = (ranges[-1][0], index)
        else:
            ranges.append((index, index))
    return ",".join(str(a) if a == b else f"{a}-{b}" for a, b in ranges)


def in_short(elements: Iterable[str]) -> str:
    """Elements as one writes them on a command line: ``4711_[0-2,5]``."""
    by_array: dict[str, list[int]] = {}
    for element in elements:
        array, _, index = element.partition("_")
        by_array.setdefault(array, []).append(int(index))
    lists = {
        array: index_list(sorted(found))
        for array, found in sorted(by_array.items(), key=lambda item: int(item[0]))
    }
    return " ".join(
        f"{array}_{one}" if one.isdecimal() else f"{array}_[{one}]" for array, one in lists.items()
    )


def short_name(label: str, name: str) -> str:
    """The name of an element in the queue, for people: ``gwo-seed1 STUDY``."""
    words = []
    for part in label.split(" "):
        key, equals, value = part.partition("=")
        words.append(f"seed{value}" if key == "seed" else (value if equals else key))
    # Commas part options for scontrol.
    return f"{'-'.join(words)[:60]} {name}".replace(",", ";")
