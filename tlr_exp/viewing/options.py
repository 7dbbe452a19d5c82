"""The options --view and --web of a command, and the viewer that they ask for."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from tlr_exp.robot.model import Robot
    from tlr_exp.viewing.recording import Recording

WEB_PORT = 8080


def add_viewers(group: Any) -> None:
    """Add both options to a mutually exclusive group of an ``ArgumentParser``."""
    group.add_argument("--view", action="store_true", help="open MuJoCo's viewer (needs a display)")
    group.add_argument(
        "--web",
        type=int,
        metavar="PORT",
        nargs="?",
        const=WEB_PORT,
        help=f"serve a 3D view to a browser on this machine (default port: {WEB_PORT})",
    )


def viewer_wanted(options: argparse.Namespace) -> bool:
    """Whether a viewer was asked for."""
    return options.view or options.web is not None


def check_port(options: argparse.Namespace) -> None:
    """
    Raises:
        ValueError: --web is no port.
    """
    if options.web is not None and not 0 <= options.web < 65536:
        raise ValueError(f"--web is {options.web}; a port is 0 (any free one) to 65535")


def require_viewer(options: argparse.Namespace) -> None:
    """Refuse a viewer that cannot be opened, before anything is computed for it.

    Raises:
        ViewerUnavailable: no display, or a package is missing.
    """
    if options.view:
        from tlr_exp.viewing.native import require_display

        require_display()
    else:
        from tlr_exp.viewing.web import require_packages

        require_packages()


def play(recording: Recording, robot: Robot, options: argparse.Namespace) -> None:
    """Show a recording in the viewer that was asked for, until it is closed.

    Raises:
        ViewerUnavailable: as ``require_viewer``; no window opens, or no port is free.
    """
    if options.view:
        from tlr_exp.viewing.native import view

        view(recording, robot)
    else:
        from tlr_exp.viewing.web import serve

        serve(recording, robot, options.web)
