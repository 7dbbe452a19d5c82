"""The size of a picture as it is written on a command line; imports nothing that draws."""

import argparse
import re

MAX_SIDE = 4096


def size_argument(text: str) -> tuple[int, int]:
    """Width and height in pixels of "640x480"; even, as videos need them.

    Raises:
        argparse.ArgumentTypeError: no size, or sides that are odd, too small or too large.
    """
    match = re.fullmatch(r"(\d+)x(\d+)", text)
    if match is None:
        raise argparse.ArgumentTypeError(f"{text!r} is no size; expected one like 640x480")
    width, height = int(match[1]), int(match[2])
    if width % 2 or height % 2 or not 16 <= min(width, height) <= max(width, height) <= MAX_SIDE:
        raise argparse.ArgumentTypeError(f"both sides must be even, from 16 to {MAX_SIDE}")
    return width, height
