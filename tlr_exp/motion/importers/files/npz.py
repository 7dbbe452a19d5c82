"""``.npz`` files as a mapping that reads an array only when asked for it, and pickles as data."""

import io
import zipfile
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from tlr_exp.motion.importers.files.safe_pickle import load_pickle
from tlr_exp.motion.importers.raw import MotionFileError


class NpzArrays(Mapping[str, Any]):
    """The arrays of an ``.npz``.

    Raises:
        MotionFileError: at construction, if it is no zip or unpacks to more than ``max_bytes``;
            at look-up, if the array is damaged, or made of Python objects other than texts.
    """

    def __init__(self, data: bytes, max_bytes: int) -> None:
        sizes = _sizes(data)
        if sum(sizes.values()) > max_bytes:
            raise MotionFileError(f"it unpacks to more than {max_bytes >> 20} MiB")
        self._data = data
        self._sizes = {name[:-4]: size for name, size in sizes.items() if name.endswith(".npy")}

    def __getitem__(self, key: str) -> Any:
        if key not in self._sizes:
            raise KeyError(key)
        try:
            with zipfile.ZipFile(io.BytesIO(self._data)) as archive:
                return read_array(archive.read(f"{key}.npy"))
        except MotionFileError:
            raise
        except Exception as error:
            raise MotionFileError(
                f"its array {key} cannot be read ({type(error).__name__})"
            ) from error

    def __iter__(self) -> Iterator[str]:
        return iter(self._sizes)

    def __len__(self) -> int:
        return len(self._sizes)


def member_names(data: bytes) -> list[str]:
    """The names of what a zip holds.

    Raises:
        MotionFileError: it is no zip.
    """
    return list(_sizes(data))


def _sizes(data: bytes) -> dict[str, int]:
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            return {info.filename: info.file_size for info in archive.infolist()}
    except Exception as error:
        # zipfile raises what it meets: BadZipFile, struct.error, NotImplementedError, ...
        raise MotionFileError("it is no intact .npz file: it may be cut off") from error


def read_array(content: bytes) -> Any:
    """An ``.npy`` file; its header is checked against its size before memory is set aside.

    Arrays of objects are pickles: of texts they become lists, of None they become None.
    """
    file = io.BytesIO(content)
    version = np.lib.format.read_magic(file)
    read = {
        (1, 0): np.lib.format.read_array_header_1_0,
        (2, 0): np.lib.format.read_array_header_2_0,
    }[version]
    shape, fortran, dtype = read(file)
    if dtype.hasobject:
        return load_pickle(content[file.tell() :], len(content))
    if 0 in shape:
        return np.empty(shape, dtype)
    flat = np.frombuffer(content, dtype=dtype, offset=file.tell())
    return flat.reshape(shape, order="F" if fortran else "C")
