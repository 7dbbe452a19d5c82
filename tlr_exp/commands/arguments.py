"""Arguments that several commands share; imports nothing that draws."""

import argparse
import re
from typing import Any

from tlr_exp.errors import UserError
from tlr_exp.viewing.viewer import Viewer

MAX_SIDE = 4096
WEB_PORT = 8080


def add_force(parser: argparse.ArgumentParser, what: str) -> None:
    """The option --force; ``what`` says in the help what it replaces."""
    parser.add_argument("--force", action="store_true", help=f"replace {what}")


def add_viewers(group: Any) -> None:
    """The options --view and --web, in a mutually exclusive group of an ``ArgumentParser``."""
    group.add_argument("--view", action="store_true", help="open MuJoCo's viewer (needs a display)")
    group.add_argument(
        "--web",
        type=int,
        metavar="PORT",
        nargs="?",
        const=WEB_PORT,
        help=f"serve a 3D view to a browser on this machine (default port: {WEB_PORT})",
    )


def viewer_of(view: bool, web: int | None) -> Viewer | None:
    """The viewer that --view or --web asks for; None where neither is given.

    Raises:
        UserError: --web is no port.
    """
    if web is not None and not 0 <= web < 65536:
        raise UserError(f"--web is {web}; a port is 0 (any free one) to 65535")
    return Viewer(web) if view or web is not None else None


def drawn_as(size: tuple[int, int] | None, quality: str | None) -> dict[str, Any]:
    """--size and --quality as what draws takes them; nothing where its own are meant."""
    sides = {} if size is None else {"width": size[0], "height": size[1]}
    return sides | ({} if quality is None else {"quality": quality})


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
