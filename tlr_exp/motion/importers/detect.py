"""Which format a file has, from its content."""

from collections.abc import Callable, Mapping
from typing import Any

from tlr_exp.motion.importers import (
    asap,
    beyondmimic,
    gmr,
    holosoma,
    lafan1,
    locomujoco,
    own,
)
from tlr_exp.motion.importers.npz import NpzArrays
from tlr_exp.motion.importers.raw import MotionFileError, Options, RawMotion, listed
from tlr_exp.motion.importers.safe_pickle import load_pickle

MAX_BYTES = 256 << 20  # of a file, and of what it unpacks to

Reader = Callable[[Mapping[str, Any], Options], list[RawMotion]]
READERS: dict[str, Reader] = {
    "asap": asap.read,
    "pbhc": asap.read,
    "lafan1": lafan1.read,
    "beyondmimic": beyondmimic.read,
    "holosoma": holosoma.read,
    "gmr": gmr.read,
    "locomujoco": locomujoco.read,
    "tlr": own.read,
}
# The keys by which a format is told; the first that fits, so the more special ones first.
_SIGNATURES: tuple[tuple[str, frozenset[str]], ...] = (
    ("tlr", frozenset({"fps", "qpos", "joint_names", "body_names", "body_pos_w"})),
    ("locomujoco", frozenset({"qpos", "joint_names", "frequency"})),
    ("holosoma", frozenset({"fps", "joint_pos", "joint_names"})),
    ("beyondmimic", frozenset({"fps", "joint_pos", "body_pos_w", "body_quat_w"})),
    ("gmr", frozenset({"fps", "root_pos", "root_rot", "dof_pos"})),
    ("pbhc", frozenset({"root_trans_offset", "dof", "root_rot", "contact_mask"})),
    ("asap", frozenset({"root_trans_offset", "dof", "root_rot"})),
    ("lafan1", frozenset({lafan1.TABLE})),
)


def parse(data: bytes) -> Mapping[str, Any]:
    """The arrays of a file by their keys, whichever container it is.

    Raises:
        MotionFileError: it is empty, damaged, malicious, or none of the containers.
    """
    if not data:
        raise MotionFileError("it is empty")
    if data[:2] == b"PK":
        return NpzArrays(data, MAX_BYTES)
    if lafan1.looks_like(data):
        return lafan1.parse(data)
    content = load_pickle(data, MAX_BYTES)
    if not isinstance(content, dict) or not all(isinstance(key, str) for key in content):
        raise MotionFileError("it is a pickle, but of no motion: expected a dict of arrays")
    return content


def detect(content: Mapping[str, Any]) -> str:
    """The name of the format, one of ``READERS``.

    Raises:
        MotionFileError: none fits.
    """
    motions = []
    if isinstance(content, dict):
        motions = [value for value in content.values() if isinstance(value, dict)]
    keys = list(motions[0] if motions else content)
    for name, signature in _SIGNATURES:
        if signature <= set(keys):
            return name
    raise MotionFileError(
        f"its format is not known; it has {listed(keys)}; known are {', '.join(READERS)}"
    )
