"""A viewer in the browser: the robot, its reference as a ghost, a time slider; on loopback only.

The meshes go to the browser once; after that each state is a position and a rotation a body.
viser serves the page and mjviser makes its meshes. Both come with the extra ``tlr_exp[web]`` and
are imported here alone, when a viewer is started.
"""

import copy
import logging
import threading
import time
from importlib.util import find_spec
from typing import Any

import mujoco
import numpy as np

from tlr_exp.pictures.framing import follow_pelvis
from tlr_exp.pictures.recording import Recording
from tlr_exp.pictures.studio import thin_meshes
from tlr_exp.robot.model import Robot
from tlr_exp.viewing import ViewerUnavailable
from tlr_exp.viewing.player import Player

HOST = "127.0.0.1"
REFRESH_S = 1 / 30
SPEEDS = {"0.1 x": 0.1, "0.25 x": 0.25, "0.5 x": 0.5, "1 x": 1.0, "2 x": 2.0}
_PACKAGES = ("viser", "mjviser")
_CELL_M = 0.006  # 393 000 triangles are too many for a browser that draws without a GPU
_FOLLOW_S = 0.4
_GHOST_RGB, _GHOST_OPACITY = (30, 110, 240), 0.35
_CAMERA_M = (2.2, -1.6, 0.5)  # from the robot
_COLLISION_GROUP = 3  # the customary group of collision shapes


def require_packages() -> None:
    """Refuse where viser or mjviser is missing.

    Raises:
        ViewerUnavailable: names what to install.
    """
    missing = [name for name in _PACKAGES if find_spec(name) is None]
    if missing:
        raise ViewerUnavailable(f"--web needs {' and '.join(missing)}: pip install -e '.[web]'")


def serve(recording: Recording, robot: Robot, port: int) -> None:
    """Serve a recording to browsers on this machine until Ctrl+C.

    Args:
        recording: what is played, in a loop.
        robot: from ``build_robot(visuals=True)``.
        port: the first one that is tried; the next free one is taken. 0: any.

    Raises:
        ViewerUnavailable: viser or mjviser is missing; no port is free.
    """
    viewer = WebViewer(recording, robot, port)
    try:
        print(f"{recording.title}: open {viewer.url} in a browser; Ctrl+C ends", flush=True)
        viewer.run(threading.Event())
    except KeyboardInterrupt:
        pass
    finally:
        viewer.close()


class WebViewer:
    """A server that shows one recording; ``run`` plays it, ``close`` ends it.

    Args:
        recording, robot, port: as ``serve``.

    Raises:
        ViewerUnavailable: as ``serve``.
    """

    def __init__(self, recording: Recording, robot: Robot, port: int = 0) -> None:
        require_packages()
        self.player = Player(recording)
        self._positions, self._rotations = body_poses(robot.model, recording.qpos)
        self._ghost: tuple[np.ndarray, np.ndarray] | None = None
        if recording.reference_qpos is not None:
            self._ghost = body_poses(robot.model, recording.reference_qpos)
        smoothing = _FOLLOW_S / recording.dt_s
        self._path = follow_pelvis(recording.qpos, smoothing) * (1.0, 1.0, 0.0)
        self._shown: tuple[int, bool] | None = None
        self._server = _start(port)
        try:
            self._add_scene(robot.model)
            self._add_controls()
        except BaseException:
            self._server.stop()
            raise
        self._show()

    @property
    def url(self) -> str:
        """Where the browser finds it."""
        return f"http://{HOST}:{self._server.get_port()}"

    def run(self, stop: threading.Event) -> None:
        """Play until ``stop`` is set; time stands still while nobody watches."""
        before = time.monotonic()
        while not stop.wait(REFRESH_S):
            now = time.monotonic()
            if self._server.get_clients():
                self.player.advance(now - before)
                self._show()
            before = now

    def close(self) -> None:
        """End the server; browsers lose their connection."""
        self._server.stop()

    # --- the scene -----------------------------------------------------------------------------
    def _add_scene(self, model: mujoco.MjModel) -> None:
        scene = self._server.scene
        scene.set_up_direction("+z")
        scene.configure_environment_map(environment_intensity=0.6)
        self._world = scene.add_frame("/world", show_axes=False)
        scene.add_grid(
            "/world/floor",
            infinite_grid=True,
            fade_distance=12.0,
            plane_color=(228, 231, 236),
            plane_opacity=1.0,
            shadow_opacity=0.3,
        )
        meshes = body_meshes(model)
        self._robot = {
            body: scene.add_mesh_trimesh(f"/world/robot/{body}", mesh)
            for body, mesh in meshes.items()
        }
        self._reference = {
            body: scene.add_mesh_simple(
                f"/world/reference/{body}",
                np.asarray(mesh.vertices),
                np.asarray(mesh.faces),
                color=_GHOST_RGB,
                opacity=_GHOST_OPACITY,
                cast_shadow=False,
                receive_shadow=False,
            )
            for body, mesh in meshes.items()
            if self._ghost is not None
        }
        height = float(self.player.recording.qpos[0, 2])
        camera = self._server.initial_camera
        camera.look_at = (0.0, 0.0, height)
        camera.position = (_CAMERA_M[0], _CAMERA_M[1], height + _CAMERA_M[2])
        camera.fov = np.radians(50.0)

    def _add_controls(self) -> None:
        recording, player, gui = self.player.recording, self.player, self._server.gui
        # Nothing of it is to leave this machine, so there is no button for it.
        gui.configure_theme(show_logo=False, show_share_button=False)
        gui.set_panel_label("tlr_exp")
        gui.add_markdown(f"**{recording.title}**")
        self._text = gui.add_markdown("")
        start, step = recording.start_s, recording.dt_s
        end = start + max(recording.duration_s, step)
        self._slider = gui.add_slider("time, s", start, end, step, start)
        self._button = gui.add_button("pause")
        self._loop = gui.add_checkbox("loop", initial_value=True)
        self._speed = gui.add_dropdown("speed", tuple(SPEEDS), initial_value="1 x")
        self._follow = gui.add_checkbox("follow the robot", initial_value=True)
        self._slider.on_update(self._on_slider)
        self._button.on_click(lambda _: player.toggle())
        self._loop.on_update(lambda _: setattr(player, "loop", self._loop.value))
        self._speed.on_update(lambda _: setattr(player, "speed", SPEEDS[self._speed.value]))
        if self._ghost is not None:
            ghost = gui.add_checkbox("reference (blue)", initial_value=True)
            ghost.on_update(lambda _: self._show_reference(ghost.value))

    def _on_slider(self, event: Any) -> None:
        # The slider also moves because time goes by; only a hand at it (a client's) pauses.
        if event.client is not None:
            self.player.playing = False
            self.player.seek(self._slider.value - self.player.recording.start_s)

    def _show_reference(self, visible: bool) -> None:
        for handle in self._reference.values():
            handle.visible = visible

    def _show(self) -> None:
        """Bring the scene and the panel up to the player's state."""
        frame, follow = self.player.frame, self._follow.value
        label = "pause" if self.player.playing else "play"
        if self._button.label != label:
            self._button.label = label
        if self._shown == (frame, follow):
            return
        self._shown = (frame, follow)
        with self._server.atomic():
            # The world moves under a camera that stands still, so that it can be turned by hand.
            self._world.position = -self._path[frame] if follow else (0.0, 0.0, 0.0)
            _place(self._robot, self._positions[frame], self._rotations[frame])
            if self._ghost is not None:
                _place(self._reference, self._ghost[0][frame], self._ghost[1][frame])
        recording = self.player.recording
        self._slider.value = round(recording.start_s + frame * recording.dt_s, 6)
        self._text.content = recording.captions[frame].replace("\n", "  \n")


def body_poses(model: mujoco.MjModel, qpos: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Positions [T, bodies, 3] in m and rotations [T, bodies, 4] (wxyz) of all of a model's bodies.

    Args:
        model: the robot.
        qpos: its states [T, nq].
    """
    data = mujoco.MjData(model)
    positions = np.empty((len(qpos), model.nbody, 3))
    rotations = np.empty((len(qpos), model.nbody, 4))
    for frame, state in enumerate(qpos):
        data.qpos[:] = state
        mujoco.mj_kinematics(model, data)
        positions[frame], rotations[frame] = data.xpos, data.xquat
    return positions, rotations


def body_meshes(model: mujoco.MjModel) -> dict[int, Any]:
    """One ``trimesh.Trimesh`` for each body that is seen, in the body's frame, by the body's id.

    Where the model has no skin its collision shapes are taken.
    """
    from mjviser.conversions import merge_geoms  # pyright: ignore[reportMissingImports]

    model = copy.copy(model)
    thin_meshes(model, _CELL_M)
    moving = model.geom_bodyid > 0
    seen = moving & (model.geom_group < _COLLISION_GROUP)
    if not seen.any():
        seen = moving
    meshes = {}
    for body in np.unique(model.geom_bodyid[seen]):
        geoms = np.flatnonzero(seen & (model.geom_bodyid == body))
        mesh = merge_geoms(model, [int(geom) for geom in geoms])
        mesh.remove_unreferenced_vertices()
        meshes[int(body)] = mesh
    return meshes


def _start(port: int) -> Any:
    """A viser server that only this machine can reach."""
    import viser  # pyright: ignore[reportMissingImports]

    # Browsers open connections in advance and drop them; each would be logged with a traceback.
    logging.getLogger("websockets.server").setLevel(logging.CRITICAL)

    class LoopbackServer(viser.ViserServer):
        def request_share_url(self, verbose: bool = True) -> str | None:
            """A page may ask viser for a tunnel to a public address; it gets none."""
            return None

    return LoopbackServer(host=HOST, port=port, verbose=False)


def _place(handles: dict[int, Any], positions: np.ndarray, rotations: np.ndarray) -> None:
    for body, handle in handles.items():
        handle.position = positions[body]
        handle.wxyz = rotations[body]
