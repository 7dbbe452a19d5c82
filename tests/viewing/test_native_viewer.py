"""MuJoCo's own viewer: what is put into it; the window itself is left out."""

import contextlib
from types import SimpleNamespace

import mujoco
import numpy as np
import pytest

from tlr_exp.pictures.recording import Recording
from tlr_exp.robot.model import Robot, build_robot
from tlr_exp.viewing import ViewerUnavailable, native
from tlr_exp.viewing.player import Player


@pytest.fixture(scope="module")
def drawn_robot() -> Robot:
    return build_robot(visuals=True)


@pytest.fixture(scope="module")
def recording(short_clip) -> Recording:
    reference = short_clip.qpos.copy()
    reference[:, 1] += 0.5
    captions = ("",) * short_clip.num_frames
    return Recording("a run", 0.02, short_clip.qpos, reference, captions)


class Window:
    """A viewer's handle that is open for a few pictures."""

    def __init__(self, model: mujoco.MjModel, pictures: int) -> None:
        self.user_scn = mujoco.MjvScene(model, 2000)
        self.opt = mujoco.MjvOption()
        self.cam = mujoco.MjvCamera()
        self.left = pictures
        self.synced = 0

    def __enter__(self):
        return self

    def __exit__(self, *_):
        return None

    def is_running(self) -> bool:
        self.left -= 1
        return self.left >= 0

    def lock(self):
        return contextlib.nullcontext()

    def sync(self) -> None:
        self.synced += 1


def test_without_a_display_it_says_what_to_do(monkeypatch):
    monkeypatch.setattr(native.sys, "platform", "linux")
    monkeypatch.setenv("DISPLAY", "")
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    with pytest.raises(ViewerUnavailable, match=r"no display .* --web shows the same"):
        native.require_display()
    monkeypatch.setenv("WAYLAND_DISPLAY", "wayland-0")
    native.require_display()


def test_the_camera_begins_with_the_whole_robot_in_view(recording):
    camera = mujoco.MjvCamera()
    native.aim(camera, recording)
    assert camera.lookat[:2] == pytest.approx(recording.qpos[0, :2])
    # MuJoCo's vertical field of view is 45 degrees: at this distance it holds a robot of 1.3 m.
    assert 2 * camera.distance * np.tan(np.radians(22.5)) > 2 * (1.3 - camera.lookat[2])
    assert 2 * camera.distance * np.tan(np.radians(22.5)) > 2 * camera.lookat[2]


def test_the_robot_and_its_ghost_are_where_they_belong(drawn_robot, recording):
    model = drawn_robot.model
    data, ghost = mujoco.MjData(model), mujoco.MjData(model)
    window = Window(model, 0)
    native.show(window, model, data, ghost, recording, 20)
    np.testing.assert_array_equal(data.qpos, recording.qpos[20])
    geoms = window.user_scn.geoms[: window.user_scn.ngeom]
    meshes = [geom for geom in geoms if geom.type == mujoco.mjtGeom.mjGEOM_MESH]
    assert len(meshes) > 20
    for geom in meshes:  # the reference is half a metre beside the robot
        expected = data.geom_xpos[geom.objid] + [0.0, 0.5, 0.0]
        np.testing.assert_allclose(geom.pos, expected, atol=1e-6)
        assert 0.0 < geom.rgba[3] < 0.5
    native.show(window, model, data, ghost, recording, 21)
    assert window.user_scn.ngeom == len(geoms)


def test_without_a_reference_there_is_no_ghost(drawn_robot, recording):
    model = drawn_robot.model
    window = Window(model, 0)
    alone = Recording("", 0.02, recording.qpos, None, recording.captions)
    native.show(window, model, mujoco.MjData(model), mujoco.MjData(model), alone, 3)
    assert window.user_scn.ngeom == 0


def test_keys(recording):
    player = Player(recording)
    native.press(player, native._SPACE)
    assert not player.playing
    native.press(player, native._RIGHT)
    native.press(player, native._RIGHT)
    native.press(player, native._LEFT)
    assert player.frame == 1
    native.press(player, native._SPACE)
    assert player.playing


def test_it_plays_until_the_window_is_closed(drawn_robot, recording, monkeypatch, capsys):
    monkeypatch.setattr(native, "require_display", lambda: None)
    window = Window(drawn_robot.model, 3)
    opened = SimpleNamespace()

    def launch(model, data, *, key_callback, **_):
        opened.data, opened.press = data, key_callback
        return window

    monkeypatch.setattr(native.mujoco.viewer, "launch_passive", launch)
    native.view(recording, drawn_robot)
    assert window.synced == 3
    told = capsys.readouterr().out
    assert "close the window" in told
    assert "Esc" not in told  # which in this viewer frees the camera
    assert (opened.data.qpos == recording.qpos).all(axis=1).any()


def test_a_window_that_does_not_open_is_explained(drawn_robot, recording, monkeypatch):
    monkeypatch.setattr(native, "require_display", lambda: None)

    def launch(*_, **__):
        raise RuntimeError("needs mjpython")

    monkeypatch.setattr(native.mujoco.viewer, "launch_passive", launch)
    with pytest.raises(ViewerUnavailable, match=r"does not open \(needs mjpython\); --web does"):
        native.view(recording, drawn_robot)
