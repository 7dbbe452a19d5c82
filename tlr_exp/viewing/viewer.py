"""The viewer that was asked for; what opens it is imported when it opens."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from tlr_exp.pictures.recording import Recording
    from tlr_exp.robot.model import Robot


@dataclass(frozen=True)
class Viewer:
    """MuJoCo's own viewer, or one in the browser.

    Attributes:
        port: where a browser finds it, 0 for any free one; None: MuJoCo's own, in a window.
    """

    port: int | None = None

    def require(self) -> None:
        """Refuse a viewer that cannot be opened, before anything is computed for it.

        Raises:
            ViewerUnavailable: no display, or a package is missing.
        """
        if self.port is None:
            from tlr_exp.viewing.native import require_display

            require_display()
        else:
            from tlr_exp.viewing.web import require_packages

            require_packages()

    def play(self, recording: Recording, robot: Robot) -> None:
        """Show a recording until the viewer is closed.

        Raises:
            ViewerUnavailable: as ``require``; no window opens, or no port is free.
        """
        if self.port is None:
            from tlr_exp.viewing.native import view

            view(recording, robot)
        else:
            from tlr_exp.viewing.web import serve

            serve(recording, robot, self.port)
