"""MuJoCo's own viewer: the robot, its reference as a ghost; space pauses, arrows step."""

import sys
import time
from typing import Any

import mujoco
import mujoco.viewer
import numpy as np

from tlr_exp.machine.variables import has_display
from tlr_exp.pictures.recording import Recording
from tlr_exp.robot.model import Robot
from tlr_exp.viewing import ViewerUnavailable
from tlr_exp.viewing.player import Player

_GHOST_RGBA = np.array([0.05, 0.42, 0.95, 0.3])
_REFRESH_S = 1 / 60
_LOOK_AT_HEIGHT_M, _DISTANCE_M, _ELEVATION_DEG = 0.7, 3.2, -12.0
# GLFW's codes of the keys.
_SPACE, _RIGHT, _LEFT = 32, 262, 263


def view(recording: Recording, robot: Robot) -> None:
    """Play a recording in a window until it is closed.

    Args:
        recording: what is played, in a loop.
        robot: from ``build_robot(visuals=True)``.

    Raises:
        ViewerUnavailable: there is no display, or the window cannot be opened.
    """
    require_display()
    player = Player(recording)
    data = mujoco.MjData(robot.model)
    data.qpos[:] = recording.qpos[0]
    try:
        handle = mujoco.viewer.launch_passive(
            robot.model,
            data,
            key_callback=lambda key: press(player, key),
            show_left_ui=False,
            show_right_ui=False,
        )
    except RuntimeError as error:  # macOS without mjpython, a display without OpenGL
        raise ViewerUnavailable(f"MuJoCo's viewer does not open ({error}); --web does") from error
    print(f"{recording.title}: space pauses, arrows step; close the window to end", flush=True)
    ghost = mujoco.MjData(robot.model)
    with handle:
        aim(handle.cam, recording)
        before = time.monotonic()
        while handle.is_running():
            now = time.monotonic()
            player.advance(now - before)
            before = now
            with handle.lock():
                show(handle, robot.model, data, ghost, recording, player.frame)
            handle.sync()
            time.sleep(_REFRESH_S)


def aim(camera: Any, recording: Recording) -> None:
    """Point the camera, which the user can move from then on, at the whole robot at the start."""
    camera.lookat[:] = (*recording.qpos[0, :2], _LOOK_AT_HEIGHT_M)
    camera.distance, camera.elevation = _DISTANCE_M, _ELEVATION_DEG


def require_display() -> None:
    """Refuse where no window can be opened: the viewer itself would end the process.

    Raises:
        ViewerUnavailable: no display.
    """
    if sys.platform == "linux" and not has_display():
        raise ViewerUnavailable(
            "there is no display ($DISPLAY is not set), which MuJoCo's viewer needs; "
            "--web shows the same in a browser"
        )


def press(player: Player, key: int) -> None:
    """What a key does: space plays or pauses; the arrows pause and go a state on or back."""
    if key == _SPACE:
        player.toggle()
    elif key in (_RIGHT, _LEFT):
        player.playing = False
        frame = player.frame + (1 if key == _RIGHT else -1)
        player.seek(frame * player.recording.dt_s)


def show(
    handle: Any,
    model: mujoco.MjModel,
    data: mujoco.MjData,
    ghost: mujoco.MjData,
    recording: Recording,
    frame: int,
) -> None:
    """Put one state into ``data``, and its reference into the handle's ``user_scn``."""
    data.qpos[:] = recording.qpos[frame]
    mujoco.mj_forward(model, data)
    scene = handle.user_scn
    scene.ngeom = 0
    if recording.reference_qpos is None:
        return
    ghost.qpos[:] = recording.reference_qpos[frame]
    mujoco.mj_kinematics(model, ghost)
    mujoco.mjv_addGeoms(
        *(model, ghost, handle.opt, mujoco.MjvPerturb()),
        *(mujoco.mjtCatBit.mjCAT_DYNAMIC, scene),
    )
    for geom in scene.geoms[: scene.ngeom]:
        geom.matid = -1
        geom.rgba[:] = _GHOST_RGBA
        geom.category = mujoco.mjtCatBit.mjCAT_DECOR
