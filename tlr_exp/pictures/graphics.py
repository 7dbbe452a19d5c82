"""An off-screen OpenGL context, found by itself: MUJOCO_GL where it is set, else EGL, else OSMesa.

MuJoCo reads ``MUJOCO_GL`` once, when it is imported, and by then it is too late to choose. The
backends are however modules of their own, so the one that works is imported here by name, whatever
MuJoCo chose. A backend is first tried in a process of its own: a broken graphics driver can crash
the process that touches it, and PyOpenGL keeps the first platform that it was loaded for.
"""

import importlib
import os
import subprocess
import sys
from functools import lru_cache
from typing import Any

from tlr_exp.errors import UserError
from tlr_exp.machine import variables

_OFF = ("disable", "disabled", "off", "false", "0")
_AUTOMATIC = ("", "enable", "enabled", "on", "true", "1")
_OFF_SCREEN = ("egl", "osmesa")
_PROBE_TIMEOUT_S = 60
_PROBE = """
import mujoco
from mujoco.{backend} import GLContext
context = GLContext(8, 8)
context.make_current()
mujoco.MjrContext(mujoco.MjModel.from_xml_string("<mujoco/>"), 150).free()
context.free()
"""
_INSTALL = "install EGL (Debian: libegl1 libgl1-mesa-dri) or OSMesa (Debian: libosmesa6)"


class GraphicsUnavailable(UserError):
    """No way to draw on this machine; the message says in one line what to install."""


def open_context(width: int, height: int) -> Any:
    """Create an off-screen OpenGL context and make it current in this thread.

    Returns:
        A MuJoCo ``GLContext`` with ``make_current()`` and ``free()``.

    Raises:
        GraphicsUnavailable: no backend works here, or MUJOCO_GL switches graphics off.
    """
    backend = graphics_backend()
    module = f"mujoco.{backend}" if backend in _OFF_SCREEN else "mujoco.gl_context"
    try:
        context = importlib.import_module(module).GLContext(width, height)
        context.make_current()
    except Exception as error:  # each backend has its own ways to fail
        raise GraphicsUnavailable(f"no pictures: {backend} fails ({error}); {_INSTALL}") from error
    return context


@lru_cache(maxsize=1)
def graphics_backend() -> str:
    """The backend in use: ``egl``, ``osmesa``, or ``native`` for a platform's own window system.

    Raises:
        GraphicsUnavailable: none works here.
    """
    wanted = variables.graphics()
    if wanted in _OFF:
        raise GraphicsUnavailable(f"no pictures: MUJOCO_GL={wanted} switches them off; unset it")
    if sys.platform != "linux" or wanted not in (*_AUTOMATIC, *_OFF_SCREEN):
        return "native"
    reasons = []
    for backend in (wanted,) if wanted in _OFF_SCREEN else _OFF_SCREEN:
        reason = _why_not(backend)
        if reason is None:
            return backend
        reasons.append(f"{backend}: {reason}")
    raise GraphicsUnavailable(f"no pictures: {_INSTALL} ({'; '.join(reasons)})")


def _why_not(backend: str) -> str | None:
    """Open the backend in a process of its own; None if it works, else its last words."""
    environment = os.environ | {variables.GRAPHICS: backend}
    try:
        done = subprocess.run(
            [sys.executable, "-c", _PROBE.format(backend=backend)],
            env=environment,
            capture_output=True,
            text=True,
            timeout=_PROBE_TIMEOUT_S,
            check=False,
        )
    except subprocess.TimeoutExpired:
        return f"no answer within {_PROBE_TIMEOUT_S} s"
    if done.returncode == 0:
        return None
    return (done.stderr.strip().splitlines() or [f"exit status {done.returncode}"])[-1]
