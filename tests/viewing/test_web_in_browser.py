"""The viewer in a real browser: the robot is seen, and the slider moves it."""

import threading

import numpy as np
import pytest
from browser import find_chromium, open_page, until

from tlr_exp.pictures.recording import Recording
from tlr_exp.robot.g1 import G1
from tlr_exp.robot.model import build_robot
from tlr_exp.viewing import web

WIDTH, HEIGHT = 1000, 600
SCENE = slice(315, WIDTH - 345)  # the columns between a warning of software rendering and the panel
_SLIDER = """(() => {
  const track = document.querySelector('[role=slider]').parentElement.getBoundingClientRect();
  return [track.left, track.right, (track.top + track.bottom) / 2];
})()"""


@pytest.mark.slow
@pytest.mark.skipif(find_chromium() is None, reason="no Chromium on this machine")
def test_a_browser_shows_the_robot_and_its_slider_moves_it(short_clip, tmp_path):
    pytest.importorskip("viser")
    pytest.importorskip("mjviser")
    qpos, reference = short_clip.qpos.copy(), short_clip.qpos.copy()
    arm = 7 + G1.joint_names.index("right_shoulder_pitch_joint")
    qpos[:, arm] = np.linspace(0.0, -2.5, len(qpos))
    reference[:, 1] -= 0.4
    captions = tuple(f"state {frame} of the clip" for frame in range(short_clip.num_frames))
    recording = Recording("a run", 0.02, qpos, reference, captions)
    viewer = web.WebViewer(recording, build_robot(visuals=True))
    viewer.player.playing = False
    stop = threading.Event()
    thread = threading.Thread(target=viewer.run, args=(stop,))
    thread.start()
    try:
        with open_page(viewer.url, tmp_path, WIDTH, HEIGHT) as page:
            until(lambda: "state 0 of the clip" in str(page.evaluate("document.body.innerText")))
            first = until(lambda: _with_robot(page.picture()))
            left, right, y = page.evaluate(_SLIDER)
            page.click(left + 0.75 * (right - left), y)
            until(lambda: viewer.player.frame > 0)
            # 30 of 40 states, but for the rounding of pixels.
            assert abs(viewer.player.frame - 30) <= 2
            text = f"state {viewer.player.frame} of the clip"
            until(lambda: text in str(page.evaluate("document.body.innerText")))
            assert until(lambda: _moved(first, page.picture()))
            assert page.errors == []
    finally:
        stop.set()
        thread.join(timeout=60)
        viewer.close()
    assert not thread.is_alive()


def _with_robot(picture: np.ndarray) -> np.ndarray | None:
    """The picture, once the blue of the reference and the black of the robot are in it."""
    scene = picture[:, SCENE].astype(int)
    blue = (scene[..., 2] - scene[..., 0] > 40).mean()
    dark = (scene.max(axis=-1) < 70).mean()
    return picture if blue > 0.005 and dark > 0.002 else None


def _moved(before: np.ndarray, now: np.ndarray) -> bool:
    """Whether the scene has changed, and not the panel alone."""
    change = np.abs(before.astype(int) - now)[:, SCENE].max(axis=-1)
    return bool((change > 60).mean() > 0.005)
