"""The viewer in the browser, without one: what is served, to whom, and where the bodies are."""

import socket
import sys
import threading
import urllib.error
import urllib.request
from pathlib import Path

import mujoco
import numpy as np
import pytest

from tlr_exp.pictures.recording import Recording
from tlr_exp.pictures.studio import thin_meshes
from tlr_exp.robot.model import Robot, build_robot
from tlr_exp.viewing import ViewerUnavailable, web

ASIDE_M = np.array([0.0, 0.4, 0.0])


@pytest.fixture(scope="module")
def drawn_robot() -> Robot:
    return build_robot(visuals=True)


@pytest.fixture(scope="module")
def recording(short_clip) -> Recording:
    reference = short_clip.qpos.copy()
    reference[:, :3] += ASIDE_M
    captions = tuple(f"state {k}" for k in range(short_clip.num_frames))
    return Recording("a run", 0.02, short_clip.qpos, reference, captions, start_s=0.02)


@pytest.fixture(scope="module")
def viewer(recording, drawn_robot):
    pytest.importorskip("viser")
    pytest.importorskip("mjviser")
    made = web.WebViewer(recording, drawn_robot)
    yield made
    made.close()


class Hand:
    """An event of a viewer's panel: of a browser, or of the program itself."""

    def __init__(self, client: object | None) -> None:
        self.client = client


def test_what_is_missing_is_named(monkeypatch, recording, drawn_robot):
    monkeypatch.setattr(web, "find_spec", lambda name: None if name == "viser" else object())
    with pytest.raises(ViewerUnavailable, match=r"needs viser: pip install -e '\.\[web\]'"):
        web.serve(recording, drawn_robot, 0)


def test_the_page_is_served(viewer):
    with urllib.request.urlopen(viewer.url, timeout=20) as answer:
        assert answer.status == 200
        assert b"<html" in answer.read().lower()


@pytest.mark.skipif(sys.platform != "linux", reason="reads /proc/net/tcp")
def test_nothing_listens_beyond_loopback(viewer):
    port = int(viewer.url.rpartition(":")[2])
    listening = []
    for table in ("tcp", "tcp6"):
        for line in Path(f"/proc/net/{table}").read_text().splitlines()[1:]:
            local, _, state = line.split()[1:4]
            if state == "0A" and int(local.split(":")[1], 16) == port:
                listening.append((table, local.split(":")[0]))
    assert listening == [("tcp", "0100007F")]  # 127.0.0.1, lowest byte first


def test_there_is_no_tunnel_to_a_public_address(viewer):
    assert viewer._server.request_share_url() is None
    assert viewer._server._share_tunnel is None


def test_bodies_are_where_the_state_puts_them(viewer, recording, drawn_robot):
    data = mujoco.MjData(drawn_robot.model)
    viewer.player.playing = False
    for frame in (7, 30):
        viewer.player.seek(frame * 0.02)
        viewer._show()
        data.qpos[:] = recording.qpos[frame]
        mujoco.mj_kinematics(drawn_robot.model, data)
        assert len(viewer._robot) == len(viewer._reference) > 20
        for body, handle in viewer._robot.items():
            np.testing.assert_allclose(handle.position, data.xpos[body], atol=1e-9)
            np.testing.assert_allclose(handle.wxyz, data.xquat[body], atol=1e-9)
            ghost = viewer._reference[body]
            np.testing.assert_allclose(ghost.position, data.xpos[body] + ASIDE_M, atol=1e-9)
        assert viewer._slider.value == pytest.approx(0.02 + frame * 0.02)
        assert viewer._text.content == f"state {frame}"


def test_a_hand_at_the_slider_pauses_and_time_itself_does_not(viewer):
    viewer.player.playing = True
    viewer._slider.value = 0.02 + 0.5
    viewer._on_slider(Hand(None))
    assert viewer.player.playing
    viewer._on_slider(Hand(object()))
    assert not viewer.player.playing
    assert viewer.player.frame == 25
    viewer._show()
    assert viewer._button.label == "play"


def test_the_world_moves_when_the_robot_is_followed(viewer, recording):
    viewer.player.seek(0.8)
    viewer._show()
    # The clip goes 0.02 m/s along x, smoothly: the camera is where the robot is.
    assert viewer._world.position[0] == pytest.approx(-0.016, abs=2e-3)
    assert viewer._world.position[2] == 0.0
    viewer._follow.value = False
    viewer._show()
    np.testing.assert_array_equal(viewer._world.position, 0.0)
    viewer._follow.value = True


def test_time_stands_still_while_nobody_watches(viewer):
    viewer.player.seek(0.0)
    viewer.player.playing = True
    stop = threading.Event()
    thread = threading.Thread(target=viewer.run, args=(stop,))
    thread.start()
    thread.join(timeout=0.3)
    stop.set()
    thread.join(timeout=20)
    assert not thread.is_alive()
    assert viewer.player.time_s == 0.0


def test_meshes_are_the_models(drawn_robot):
    """Each vertex of a body's mesh is a vertex of the model's, put where its shape is."""
    pytest.importorskip("mjviser")
    model = drawn_robot.model
    thinned = mujoco.MjModel.__copy__(model)
    thin_meshes(thinned, web._CELL_M)
    meshes = web.body_meshes(model)
    assert sum(len(mesh.faces) for mesh in meshes.values()) < 150_000
    shapes = np.flatnonzero(
        (model.geom_type == mujoco.mjtGeom.mjGEOM_MESH) & (model.geom_group < 3)
    )
    for geom in shapes[::5]:
        i = model.geom_dataid[geom]
        faces = thinned.mesh_face[thinned.mesh_faceadr[i] :][: thinned.mesh_facenum[i]]
        vertices = thinned.mesh_vert[thinned.mesh_vertadr[i] + faces.ravel()]
        rotation = np.empty(9)
        mujoco.mju_quat2Mat(rotation, model.geom_quat[geom])
        placed = vertices @ rotation.reshape(3, 3).T + model.geom_pos[geom]
        low, high = meshes[int(model.geom_bodyid[geom])].bounds
        assert (placed > low - 1e-6).all()
        assert (placed < high + 1e-6).all()
    assert model.mesh_facenum.sum() > 300_000  # the model itself is left as it was


def test_a_port_that_is_taken_is_passed_over(recording, drawn_robot):
    pytest.importorskip("viser")
    pytest.importorskip("mjviser")
    with socket.socket() as taken:
        taken.bind((web.HOST, 0))
        taken.listen()
        port = taken.getsockname()[1]
        second = web.WebViewer(recording, drawn_robot, port)
        assert int(second.url.rpartition(":")[2]) > port
        second.close()
    with pytest.raises(urllib.error.URLError):
        urllib.request.urlopen(second.url, timeout=5)


def test_serving_ends_with_ctrl_c(recording, drawn_robot, monkeypatch, capsys):
    pytest.importorskip("viser")
    pytest.importorskip("mjviser")
    urls = []

    def interrupt(self, stop):
        urls.append(self.url)
        raise KeyboardInterrupt

    monkeypatch.setattr(web.WebViewer, "run", interrupt)
    web.serve(recording, drawn_robot, 0)
    assert f"a run: open {urls[0]} in a browser" in capsys.readouterr().out
    with pytest.raises(urllib.error.URLError):
        urllib.request.urlopen(urls[0], timeout=5)
