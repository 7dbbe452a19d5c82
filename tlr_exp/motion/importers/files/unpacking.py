"""Compressed files, taken apart up to a limit of size."""

import bz2
import lzma
import zlib

from tlr_exp.motion.importers.raw import MotionFileError

_LZMA_MEMORY = 128 << 20  # the largest dictionary of xz's presets, twice


def unpacked(data: bytes, max_bytes: int) -> bytes:
    """The content of zlib, gzip, bz2 or xz; anything else as it is.

    Raises:
        MotionFileError: it unpacks to more than ``max_bytes``.
    """
    if data[:2] == b"\x1f\x8b" or (data[:1] == b"\x78" and data[1:2] in b"\x01\x5e\x9c\xda"):
        out = zlib.decompressobj(wbits=47).decompress(data, max_bytes + 1)
    elif data[:3] == b"BZh":
        out = bz2.BZ2Decompressor().decompress(data, max_bytes + 1)
    elif data[:6] == b"\xfd7zXZ\x00":
        out = lzma.LZMADecompressor(memlimit=_LZMA_MEMORY).decompress(data, max_bytes + 1)
    else:
        return data
    if len(out) > max_bytes:
        raise MotionFileError(f"it unpacks to more than {max_bytes >> 20} MiB")
    return out
