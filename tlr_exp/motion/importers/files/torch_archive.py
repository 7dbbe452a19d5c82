"""Archives that ``torch.save`` writes, read as data: torch takes no part, nothing is called.

Such a file is a zip of a pickle and of the tensors' bytes. The pickle is read as in
``safe_pickle``, with inert stand-ins for the few names of torch that a tensor needs; tensors
become numpy arrays that look into the bytes of their storage.
"""

import io
import zipfile
from typing import Any, ClassVar

import numpy as np

from tlr_exp.errors import UserError
from tlr_exp.motion.importers.files.safe_pickle import DataUnpickler, Global, load_with
from tlr_exp.motion.importers.raw import MotionFileError

# What a storage's name means; bfloat16 has no name in numpy.
_KINDS = {
    "DoubleStorage": "f8",
    "FloatStorage": "f4",
    "HalfStorage": "f2",
    "LongStorage": "i8",
    "IntStorage": "i4",
    "ShortStorage": "i2",
    "CharStorage": "i1",
    "ByteStorage": "u1",
    "BoolStorage": "b1",
}
_NAMES = {
    ("torch._utils", "_rebuild_tensor_v2"),
    ("collections", "OrderedDict"),
    # A word that ProtoMotions writes beside the arrays of a motion; it is not used.
    ("protomotions.simulator.base_simulator.simulator_state", "StateConversion"),
}
_STEM = "data.pkl"


def torch_pickle(names: list[str]) -> str | None:
    """The member of a zip that is the pickle of a torch archive, or None."""
    found = [n for n in names if n.endswith(f"/{_STEM}") and n.count("/") == 1]
    return found[0] if len(found) == 1 else None


def load_torch(data: bytes, max_bytes: int) -> Any:
    """What an archive of ``torch.save`` holds, its tensors as numpy arrays (read-only).

    Raises:
        MotionFileError: it is damaged, a program, unpacks to too much, or names anything that no
            motion needs.
    """
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            infos = archive.infolist()
            if sum(info.file_size for info in infos) > max_bytes:
                raise MotionFileError(f"it unpacks to more than {max_bytes >> 20} MiB")
            names = [info.filename for info in infos]
            member = torch_pickle(names)
            if member is None:
                raise MotionFileError("it is no archive of torch")
            folder = member.removesuffix(_STEM)
            if f"{folder}constants.pkl" in names:
                raise MotionFileError("it is a program of torch (TorchScript), not a motion")
            order = f"{folder}byteorder"
            big = order in names and archive.read(order).strip() == b"big"
            program = archive.read(member)
            tensors = _Tensors(archive, folder, ">" if big else "<")
            return load_with(lambda file: _TorchUnpickler(file, tensors), program, max_bytes)
    except MotionFileError as error:
        raise MotionFileError(f"{error} (it is an archive of torch)") from error
    except Exception as error:
        # zipfile raises what it meets: BadZipFile, struct.error, NotImplementedError, ...
        raise MotionFileError(
            f"it is no intact archive of torch ({type(error).__name__}): it may be cut off"
        ) from error


class _Tensors:
    """The storages of an archive, each read once."""

    def __init__(self, archive: zipfile.ZipFile, folder: str, order: str) -> None:
        self._archive, self._folder, self._order = archive, folder, order
        self._raw: dict[str, bytes] = {}

    def storage(self, kind: str, key: str) -> np.ndarray:
        if key not in self._raw:
            self._raw[key] = self._archive.read(f"{self._folder}data/{key}")
        if kind == "BFloat16Storage":
            upper = np.frombuffer(self._raw[key], f"{self._order}u2").astype(np.uint32) << 16
            return upper.view(np.float32)
        return np.frombuffer(self._raw[key], self._order + _KINDS[kind])


class _TorchUnpickler(DataUnpickler):
    def __init__(self, file: io.BytesIO, tensors: _Tensors) -> None:
        super().__init__(file)
        self.tensors = tensors

    def marker(self, module: str, name: str) -> Global | None:
        storages = (*_KINDS, "BFloat16Storage")
        if (module, name) in _NAMES or (module == "torch" and name in storages):
            return Global(name)
        return super().marker(module, name)

    def call(self, called: Any, args: Any) -> Any:
        if isinstance(called, Global):
            if called.name == "_rebuild_tensor_v2":
                return _tensor(*args[:4])
            if called.name == "OrderedDict" and not args:
                return {}
            if called.name == "StateConversion":
                return None
        return super().call(called, args)

    def load_binpersid(self) -> None:
        word, kind, key, _, _ = self.stack.pop()
        if word != "storage" or not isinstance(kind, Global) or not isinstance(key, str):
            raise MotionFileError("it refers to what is no tensor; nothing in it was run")
        self.append(self.tensors.storage(kind.name, key))

    dispatch: ClassVar = {**DataUnpickler.dispatch, b"Q"[0]: load_binpersid}


def _tensor(storage: Any, offset: Any, shape: Any, strides: Any) -> np.ndarray:
    """A view into a storage; what would reach beyond it is refused."""
    numbers = (offset, *shape, *strides)
    if not all(type(n) is int and n >= 0 for n in numbers) or len(shape) != len(strides):
        raise UserError("no shape")
    last = offset + sum((n - 1) * step for n, step in zip(shape, strides, strict=True))
    count = 1
    for length in shape:
        count *= length
    # An expanded tensor, of stride 0, could be larger than any memory.
    if count > storage.size or (count and last >= storage.size):
        raise UserError("beyond the storage")
    return np.lib.stride_tricks.as_strided(
        storage[offset:], shape, [s * storage.itemsize for s in strides], writeable=False
    )
