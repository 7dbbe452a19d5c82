"""Pickles read as data: nothing in the file is ever called.

A pickle is a small program that may name any function and call it. This reader gives it no
function to call: the few numpy and joblib names that a motion needs become inert markers, the
instructions that call or change objects know these markers only, and every other name ends the
reading. Arrays are rebuilt here from their bytes. It is written on Python's own (slower)
implementation of the instructions, because the one in C sets aside memory as a file demands it.
"""

import io
import pickle
import re
import struct
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from tlr_exp.errors import UserError
from tlr_exp.motion.importers.files.unpacking import unpacked
from tlr_exp.motion.importers.raw import DamagedError, MotionFileError

_NUMPY = "ndarray", "dtype", "_reconstruct", "scalar", "_frombuffer"
_JOBLIB = "joblib.numpy_pickle", "NumpyArrayWrapper"
_MODULES = re.compile(r"numpy(\.(core|_core)\.(multiarray|numeric))?")
_DTYPE = re.compile(r"[<>|=]?([iu][1248]|f[248]|b1|[US]\d{1,4})")

# Instructions that make and nest plain values.
# fmt: off
_PLAIN_NAMES = (
    "PROTO", "FRAME", "STOP", "MARK", "POP", "POP_MARK", "DUP", "NONE", "NEWTRUE", "NEWFALSE",
    "INT", "LONG", "LONG1", "LONG4", "FLOAT", "BININT", "BININT1", "BININT2", "BINFLOAT",
    "STRING", "BINSTRING", "SHORT_BINSTRING", "BINBYTES", "SHORT_BINBYTES", "BINBYTES8",
    "UNICODE", "BINUNICODE", "SHORT_BINUNICODE", "BINUNICODE8", "EMPTY_TUPLE", "TUPLE", "TUPLE1",
    "TUPLE2", "TUPLE3", "EMPTY_LIST", "LIST", "APPEND", "APPENDS", "EMPTY_DICT", "PUT", "BINPUT",
    "LONG_BINPUT", "MEMOIZE", "GET", "BINGET", "LONG_BINGET", "GLOBAL", "STACK_GLOBAL",
)
# fmt: on
_PLAIN = tuple(getattr(pickle, name)[0] for name in _PLAIN_NAMES)
_OPCODE_NAMES = {
    getattr(pickle, name)[0]: name
    for name in dir(pickle)
    if name.isupper() and isinstance(getattr(pickle, name), bytes) and len(name) > 1
}


def load_pickle(data: bytes, max_bytes: int) -> Any:
    """What a pickle or joblib file holds, from containers, numbers, texts and numpy arrays.

    Args:
        data: the file, plain or compressed (zlib, gzip, bz2, xz).
        max_bytes: limit of the unpacked size.

    Raises:
        MotionFileError: the file names anything else (the message says what), or is damaged.
    """
    return load_with(DataUnpickler, data, max_bytes)


def load_with(
    unpickler: "Callable[[io.BytesIO], DataUnpickler]", data: bytes, max_bytes: int
) -> Any:
    """As ``load_pickle``, by an unpickler that may know more names."""
    try:
        return _plain(unpickler(io.BytesIO(unpacked(data, max_bytes))).load())
    except MotionFileError:
        raise
    except Exception as error:
        # A damaged pickle can break the interpreter of its instructions in any way at all.
        raise DamagedError(f"it is no intact pickle ({type(error).__name__})") from error


@dataclass(frozen=True)
class Global:
    """Stands for a permitted name; it is not callable."""

    name: str


@dataclass(eq=False)
class _Dtype:
    code: str
    order: str = ""

    def build(self, state: Any, file: io.BytesIO) -> None:
        if state[1] not in ("<", ">", "=", "|"):
            raise UserError("no byte order")
        self.order = state[1]

    @property
    def dtype(self) -> np.dtype:
        text = self.order + self.code if isinstance(self.code, str) else ""
        if not _DTYPE.fullmatch(text):
            raise MotionFileError(
                f"it holds an array of type {text[:20]!r}; expected numbers; nothing in it was run"
            )
        return np.dtype(text)


@dataclass(eq=False)
class _Array:
    """An array that its BUILD instruction fills; numpy's own state, or joblib's wrapper."""

    joblib: bool
    array: Any = None

    def build(self, state: Any, file: io.BytesIO) -> None:
        if not self.joblib:
            _, shape, kind, fortran, raw = state
            order = "F" if fortran else "C"
            if type(raw) is list:
                self.array = _texts(raw)
                return
        else:
            shape, kind, order = state["shape"], state["dtype"], state["order"]
            # The array's bytes stand behind the instruction, from joblib 1.2 on with padding.
            if state.get("numpy_array_alignment_bytes") is not None:
                file.read(file.read(1)[0])
            size = kind.dtype.itemsize
            for length in shape:
                size *= length
            raw = file.read(max(size, 0))
        self.array = _array(raw, kind, shape, order)


def _texts(items: list[Any]) -> list[str] | None:
    """What an array of Python objects may hold: texts, or the None that stands for nothing."""
    if items == [None]:
        return None
    if not all(type(item) is str for item in items):
        raise MotionFileError("it holds an array of objects that are no texts")
    return items


def _array(raw: Any, kind: Any, shape: Any, order: Any) -> np.ndarray:
    if isinstance(raw, str):
        raw = raw.encode("latin-1")
    flat = np.frombuffer(raw, dtype=kind.dtype) if len(raw) else np.empty(0, kind.dtype)
    if not all(type(length) is int and length >= 0 for length in shape):
        raise UserError("negative length")
    return flat.reshape(tuple(shape), order="F" if order == "F" else "C")


def _refuser(instruction: str) -> Callable[[Any], None]:
    def refuse(unpickler: Any) -> None:
        raise MotionFileError(
            f"it holds the pickle instruction {instruction}, which no motion needs: the file may "
            "be malicious; nothing in it was run"
        )

    return refuse


def _check_keys(keys: list[Any]) -> None:
    if not all(isinstance(key, str | int) for key in keys):
        raise MotionFileError("it holds a dict whose keys are no texts")


class DataUnpickler(pickle._Unpickler):
    """The instructions of a pickle, with ``marker`` and ``call`` for the names that it may use."""

    def __init__(self, file: io.BytesIO) -> None:
        super().__init__(file, encoding="latin-1")
        self.source = file

    def marker(self, module: str, name: str) -> "Global | None":
        """What stands for a name that a motion may use; None for any other."""
        if (module, name) == _JOBLIB or (name in _NUMPY and _MODULES.fullmatch(module)):
            return Global(name)
        # By these two, protocol 2 writes bytes.
        if (module, name) in (("_codecs", "encode"), ("__builtin__", "bytes")):
            return Global(name)
        return None

    def call(self, called: Any, args: Any) -> Any:
        """What a permitted name stands for, given its arguments."""
        if not isinstance(called, Global) or called.name not in _MAKERS:
            raise MotionFileError("it calls what is no function of numpy's; nothing in it was run")
        return _MAKERS[called.name](*args)

    def find_class(self, module: str, name: str) -> Any:
        marker = self.marker(module, name)
        if marker is not None:
            return marker
        raise MotionFileError(
            f"it asks to load {_shown(module)}.{_shown(name)}, which no motion needs: the file "
            "may be malicious; nothing in it was run"
        )

    def load_reduce(self) -> None:
        args = self.stack.pop()
        self.stack[-1] = self.call(self.stack[-1], args)

    def load_build(self) -> None:
        state = self.stack.pop()
        target = self.stack[-1]
        if not isinstance(target, _Dtype | _Array):
            raise MotionFileError("it changes an object that is no array; nothing in it was run")
        target.build(state, self.source)

    def load_bytearray8(self) -> None:
        (size,) = struct.unpack("<Q", self.read(8))
        self.append(self.read(size))

    # Keys of any other kind could take for ever to hash.
    def load_setitem(self) -> None:
        _check_keys(self.stack[-2:-1])
        super().load_setitem()

    def load_setitems(self) -> None:
        _check_keys(self.stack[::2])
        super().load_setitems()

    def load_dict(self) -> None:
        _check_keys(self.stack[::2])
        super().load_dict()

    dispatch: ClassVar[dict[int, Callable[..., None]]] = {
        **{code: _refuser(name) for code, name in _OPCODE_NAMES.items()},
        **{code: pickle._Unpickler.dispatch[code] for code in _PLAIN},
        pickle.REDUCE[0]: load_reduce,
        pickle.NEWOBJ[0]: load_reduce,
        pickle.BUILD[0]: load_build,
        pickle.BYTEARRAY8[0]: load_bytearray8,
        pickle.SETITEM[0]: load_setitem,
        pickle.SETITEMS[0]: load_setitems,
        pickle.DICT[0]: load_dict,
    }


_MAKERS: dict[str, Callable[..., Any]] = {
    "dtype": lambda code, *_: _Dtype(code),
    "_reconstruct": lambda *_: _Array(joblib=False),
    "NumpyArrayWrapper": lambda *_: _Array(joblib=True),
    "scalar": lambda kind, raw: _array(raw, kind, (), "C")[()],
    "_frombuffer": lambda raw, kind, shape, order: _array(raw, kind, shape, order),
    "encode": lambda text, codec: _encode(text, codec),
    "bytes": lambda: b"",
}


def _encode(text: Any, codec: Any) -> bytes:
    if not isinstance(text, str) or codec not in ("latin1", "latin-1"):
        raise UserError("not a byte string")
    return text.encode("latin-1")


def _plain(content: Any) -> Any:
    """Markers replaced by their arrays: of a motion, or of every motion in a dict of them."""
    if type(content) is not dict:
        return _array_of(content)
    return {
        name: _arrays(value) if type(value) is dict else _array_of(value)
        for name, value in content.items()
    }


def _arrays(content: dict[Any, Any]) -> dict[Any, Any]:
    return {key: _array_of(value) for key, value in content.items()}


def _array_of(value: Any) -> Any:
    return value.array if isinstance(value, _Array) else value


def _shown(name: str) -> str:
    return ascii(name)[1:-1][:60]
