"""From the bytes of a file to its arrays; what is no motion is called by its name."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from tlr_exp.motion.importers.files.npz import NpzArrays, member_names, read_array
from tlr_exp.motion.importers.files.safe_pickle import load_pickle
from tlr_exp.motion.importers.files.text_table import TABLE, is_text, looks_like_text, parse_text
from tlr_exp.motion.importers.files.torch_archive import load_torch, torch_pickle
from tlr_exp.motion.importers.raw import DamagedError, MotionFileError

MAX_BYTES = 256 << 20  # of a file, and of what it unpacks to

_PERSON = "it is of a person's skeleton, not of the robot: retarget it first (GMR and others do)"
# How files begin that people have beside their motions, and what to say of them.
_OTHERS = (
    (b"version https://git-lfs", "it is a Git LFS pointer, not the file: fetch the file itself "
     "(git lfs pull, or the download link of the page)"),
    (b"HIERARCHY", f"it is a BVH; {_PERSON}"),
    (b"Kaydara FBX", f"it is an FBX; {_PERSON}"),
    (b"; FBX", f"it is an FBX; {_PERSON}"),
    (b":ASF", f"it is an ASF skeleton; {_PERSON}"),
    (b"#!OML:ASF", f"it is an AMC or ASF; {_PERSON}"),
    (b"\x89HDF", "it is an HDF5 file, which is not known here; write its arrays as .npz"),
    (b"<!DOCTYPE", "it is a web page: the download of the motion itself went wrong"),
    (b"<!doctype", "it is a web page: the download of the motion itself went wrong"),
    (b"<html", "it is a web page: the download of the motion itself went wrong"),
    (b"<?xml", "it is XML: a model or a scene, not a motion"),
    (b"<mujoco", "it is a MuJoCo model, not a motion"),
    (b"<robot", "it is a URDF model, not a motion"),
    (b"{", "it is JSON, which is not known here; write its arrays as .npz"),
    (b"PAR1", "it is a Parquet file, which is not known here; write its table as .csv"),
    (b"7z\xbc\xaf", "it is a 7z archive: unpack it first"),
    (b"Rar!", "it is a RAR archive: unpack it first"),
    (b"\x80\x02\x8a\x0al\xfc\x9cF\xf9 j\xa8P\x19.", "it is an archive of torch from before 1.6; "
     "read it and write it again with torch.save"),
)  # fmt: skip
_NPY = b"\x93NUMPY"
_SHOWN = 60


def parse(data: bytes) -> Mapping[str, Any]:
    """The arrays of a file by their keys, whichever container it is.

    Raises:
        MotionFileError: it is empty, damaged, malicious, or none of the containers.
    """
    if not data:
        raise MotionFileError("it is empty")
    start = data[:64].removeprefix(b"\xef\xbb\xbf").lstrip()
    for beginning, words in _OTHERS:
        if start.startswith(beginning):
            raise MotionFileError(words)
    if data[257:262] == b"ustar":
        raise MotionFileError("it is a tar archive: unpack it first")
    if data[:2] == b"PK":
        return _zipped(data)
    if data.startswith(_NPY):
        return _lone_array(data)
    if looks_like_text(data):
        return parse_text(data)
    try:
        return _motion_dict(load_pickle(data, MAX_BYTES), "a pickle")
    except DamagedError as error:
        if is_text(data):  # a pickle may be, but this is none
            first = data.split(b"\n", 1)[0][:_SHOWN].decode("utf-8", "replace").strip()
            raise MotionFileError(
                f"it is a text, but no table of numbers: it begins with {first!r}"
            ) from error
        raise


def _zipped(data: bytes) -> Mapping[str, Any]:
    names = member_names(data)
    if torch_pickle(names) is not None:
        return _motion_dict(load_torch(data, MAX_BYTES), "an archive of torch")
    if names and not any(name.endswith(".npy") for name in names):
        raise MotionFileError("it is a zip archive without arrays: unpack it first")
    return NpzArrays(data, MAX_BYTES)


def _lone_array(data: bytes) -> Mapping[str, Any]:
    try:
        array = read_array(data)
    except MotionFileError:
        raise
    except Exception as error:
        # A damaged header can break numpy's reading of it in any way at all.
        raise MotionFileError(f"it is no intact .npy file ({type(error).__name__})") from error
    if isinstance(array, dict):
        return _motion_dict(array, "an .npy file")
    if not isinstance(array, np.ndarray) or array.ndim != 2 or array.dtype.kind not in "fiu":
        shape = list(array.shape) if isinstance(array, np.ndarray) else "of objects"
        raise MotionFileError(
            f"it is a single array (.npy), {shape}; expected a table [frames, columns], with the "
            "root's seven columns and the joints"
        )
    return {TABLE: array}


def _motion_dict(content: Any, container: str) -> Mapping[str, Any]:
    if not isinstance(content, dict) or not all(isinstance(key, str) for key in content):
        raise MotionFileError(f"it is {container}, but of no motion: expected a dict of arrays")
    return content
