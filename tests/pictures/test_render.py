"""Pictures: what is drawn, what is written, and what happens where nothing can be drawn."""

import os
import subprocess
import sys
from pathlib import Path

import imageio.v3 as iio
import imageio_ffmpeg
import numpy as np
import pytest

from tlr_exp.pictures.media import write_image, write_video
from tlr_exp.pictures.render import Camera, render_frames
from tlr_exp.pictures.studio import thin_meshes
from tlr_exp.records.storage import StorageError
from tlr_exp.robot.model import Robot, build_robot

SIZE = {"width": 64, "height": 48}
USUAL = Camera()


@pytest.fixture(scope="session")
def robot() -> Robot:
    return build_robot(visuals=True)


def standing(robot: Robot, num_frames: int = 1) -> np.ndarray:
    qpos = np.zeros((num_frames, 30))
    qpos[:, 2], qpos[:, 3] = 0.76, 1.0
    qpos[:, 7:] = robot.default_joint_pos_rad
    return qpos


def noise_frames(count: int, height: int = 48, width: int = 64) -> list[np.ndarray]:
    rng = np.random.default_rng(0)
    return [rng.integers(0, 256, (height, width, 3), dtype=np.uint8) for _ in range(count)]


def read_video(path: Path, height: int = 48, width: int = 64) -> tuple[np.ndarray, float]:
    """All frames and the duration in seconds, by ffmpeg itself (imageio's reader leaks pipes)."""
    command = [imageio_ffmpeg.get_ffmpeg_exe(), "-v", "error", "-i", str(path)]
    raw = ["-f", "rawvideo", "-pix_fmt", "rgb24", "-"]
    done = subprocess.run([*command, *raw], capture_output=True, check=True)
    frames = np.frombuffer(done.stdout, np.uint8).reshape(-1, height, width, 3)
    count, duration_s = imageio_ffmpeg.count_frames_and_secs(str(path))
    assert count == len(frames)
    return frames, duration_s


def silhouette(robot: Robot, qpos: np.ndarray, camera: Camera = USUAL) -> np.ndarray:
    """Where a single state's picture differs from that of the empty floor, bool [48, 64]."""
    away = qpos.copy()
    away[:, 0] += 50.0
    frame, empty = (
        next(render_frames(robot, state, lookat=qpos[:, :3], camera=camera, **SIZE)).astype(int)
        for state in (qpos, away)
    )
    return np.any(np.abs(frame - empty) > 12, axis=-1)


# --- frames ----------------------------------------------------------------------------------


@pytest.mark.usefixtures("can_draw")
@pytest.mark.parametrize("quality", ["fast", "full"])
def test_frames_show_a_robot_on_a_lit_floor(robot, quality):
    frames = list(render_frames(robot, standing(robot, 2), quality=quality, **SIZE))
    assert len(frames) == 2
    assert frames[0].shape == (48, 64, 3)
    assert frames[0].dtype == np.uint8
    np.testing.assert_array_equal(frames[0], frames[1])
    assert frames[0].mean() > 150  # well lit
    assert frames[0][:5].mean() > frames[0][-5:].mean()  # sky above, floor below
    drawn = silhouette(robot, standing(robot))
    assert 0.03 < drawn.mean() < 0.5  # the robot and its shadow, in the middle
    assert drawn[:, 24:40].sum() > 0.6 * drawn.sum()


@pytest.mark.usefixtures("can_draw")
def test_ghost_shows_where_it_differs_from_the_robot_and_nowhere_else(robot):
    qpos = standing(robot)
    ghost = qpos.copy()
    ghost[:, 1] += 0.4
    plain = next(render_frames(robot, qpos, **SIZE)).astype(int)
    beside = next(render_frames(robot, qpos, ghost, **SIZE)).astype(int)
    hidden = next(render_frames(robot, qpos, qpos, **SIZE)).astype(int)
    changed = np.any(np.abs(beside - plain) > 8, axis=-1)
    assert changed.mean() > 0.02
    # The ghost is blue and translucent: it takes red away, and the floor's pattern stays.
    assert (beside - plain)[changed][:, 0].mean() < (beside - plain)[changed][:, 2].mean() - 20
    assert np.any(np.abs(hidden - plain) > 8, axis=-1).sum() < 0.15 * changed.sum()


@pytest.mark.usefixtures("can_draw")
def test_camera_follows_and_looks_the_robot_in_the_face_whatever_its_heading(robot):
    here = standing(robot)
    there = here.copy()
    there[:, :2] = [3.0, -7.0]
    there[:, 3:7] = [np.cos(0.6), 0.0, 0.0, np.sin(0.6)]
    first, second = silhouette(robot, here)[:30], silhouette(robot, there)[:30]  # no shadow there
    assert (first & second).sum() > 0.7 * (first | second).sum()
    side = silhouette(robot, here, Camera(azimuth_deg=90.0))[:30]
    assert (first & side).sum() < 0.7 * (first | side).sum()


@pytest.mark.usefixtures("can_draw")
def test_captions_are_written_into_the_corner(robot):
    qpos = standing(robot)
    plain = next(render_frames(robot, qpos, width=128, height=96))
    written = next(render_frames(robot, qpos, width=128, height=96, captions=["0.52 s"]))
    changed = np.any(plain != written, axis=-1)
    assert changed.any()
    assert not changed[40:].any()


@pytest.mark.usefixtures("can_draw")
def test_a_robot_without_meshes_is_drawn_by_its_collision_shapes():
    bare = build_robot()
    assert silhouette(bare, standing(bare)).mean() > 0.03


def test_states_that_cannot_be_drawn_are_refused(robot):
    qpos = standing(robot, 3)
    broken = qpos.copy()
    broken[2, 5] = np.nan
    for arguments, message in (
        ({"qpos": qpos[:, :29]}, "qpos has the shape"),
        ({"qpos": qpos[:0]}, "qpos has the shape"),
        ({"qpos": broken}, "frame 2 holds values that are not finite"),
        ({"qpos": qpos, "ghost_qpos": qpos[:2]}, "ghost_qpos has the shape"),
        ({"qpos": qpos, "captions": ["one"]}, "1 captions for 3 frames"),
        ({"qpos": qpos, "quality": "best"}, "allowed are fast, full"),
    ):
        with pytest.raises(ValueError, match=message):
            render_frames(robot, **arguments)


# --- meshes ----------------------------------------------------------------------------------


def test_thinned_meshes_keep_their_shape_with_far_fewer_triangles():
    robot = build_robot(visuals=True)  # its own: it is changed in place
    model = robot.model
    before = model.mesh_facenum.copy()
    torso = model.mesh("torso_link").id
    start, count = model.mesh_vertadr[torso], model.mesh_vertnum[torso]
    box = [f(model.mesh_vert[start : start + count], axis=0) for f in (np.min, np.max)]
    area = surface_area(model, torso)
    thin_meshes(model, 0.010)
    assert model.mesh_facenum.sum() < before.sum() / 5
    assert (model.mesh_facenum > 50).all()
    box_after = [f(model.mesh_vert[start : start + count], axis=0) for f in (np.min, np.max)]
    np.testing.assert_allclose(box_after, box, atol=0.010)
    assert surface_area(model, torso) == pytest.approx(area, rel=0.35)
    for i in range(model.nmesh):
        faces = model.mesh_face[model.mesh_faceadr[i] :][: model.mesh_facenum[i]]
        assert (np.diff(np.sort(faces, axis=1), axis=1) > 0).all()
        assert faces.max() < model.mesh_vertnum[i]


def surface_area(model, mesh: int) -> float:
    faces = model.mesh_face[model.mesh_faceadr[mesh] :][: model.mesh_facenum[mesh]]
    a, b, c = model.mesh_vert[model.mesh_vertadr[mesh] :][faces].transpose(1, 0, 2)
    return 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1).sum()


# --- files -----------------------------------------------------------------------------------


def test_video_is_read_back_with_its_size_and_number_of_frames(tmp_path):
    path = tmp_path / "clip.mp4"
    write_video(path, iter(noise_frames(7)), fps=25)
    frames, duration_s = read_video(path)
    assert frames.shape == (7, 48, 64, 3)
    assert duration_s == pytest.approx(7 / 25, abs=0.01)
    assert [p.name for p in tmp_path.iterdir()] == ["clip.mp4"]


def test_video_shows_the_frames_that_went_in(tmp_path):
    grey = [np.full((48, 64, 3), level, np.uint8) for level in (40, 120, 200)]
    read, _ = read_video(write_video(tmp_path / "grey.mp4", grey, fps=10))
    np.testing.assert_allclose(read.mean(axis=(1, 2, 3)), [40, 120, 200], atol=3)


def test_a_failed_video_leaves_the_old_file_and_no_rest(tmp_path):
    path = tmp_path / "clip.mp4"
    path.write_bytes(b"the old one")

    def interrupted():
        yield from noise_frames(3)
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        write_video(path, interrupted(), fps=25)
    with pytest.raises(ValueError, match="among video frames"):
        write_video(path, [*noise_frames(2), *noise_frames(1, height=64)], fps=25)
    with pytest.raises(ValueError, match="even"):
        write_video(path, noise_frames(2, width=63), fps=25)
    with pytest.raises(ValueError, match="at least one frame"):
        write_video(path, [], fps=25)
    assert path.read_bytes() == b"the old one"
    assert [p.name for p in tmp_path.iterdir()] == ["clip.mp4"]


def test_a_video_into_no_folder_is_told_in_one_line(tmp_path):
    with pytest.raises(StorageError, match=r"cannot write .*clip\.mp4.*No such file"):
        write_video(tmp_path / "no" / "clip.mp4", noise_frames(2), fps=25)


def test_image_is_read_back_exactly(tmp_path):
    image = noise_frames(1)[0]
    np.testing.assert_array_equal(iio.imread(write_image(tmp_path / "a.png", image)), image)
    assert [p.name for p in tmp_path.iterdir()] == ["a.png"]


# --- machines without graphics ---------------------------------------------------------------

_DRAW = """
import sys, mujoco, numpy as np
from tlr_exp.pictures.graphics import GraphicsUnavailable
from tlr_exp.pictures.media import write_video
from tlr_exp.pictures.render import render_frames
from tlr_exp.robot.model import build_robot
qpos = np.zeros((2, 30)); qpos[:, 2] = 0.76; qpos[:, 3] = 1.0
try:
    write_video(sys.argv[1], render_frames(build_robot(), qpos, width=64, height=48), 25)
except GraphicsUnavailable as error:
    print(error)
    sys.exit(7)
"""


def draw_elsewhere(folder: Path, **environment: str) -> subprocess.CompletedProcess:
    kept = {name: value for name, value in os.environ.items() if name != "MUJOCO_GL"}
    return subprocess.run(
        [sys.executable, "-W", "error", "-c", _DRAW, str(folder / "clip.mp4")],
        env={**kept, **environment},
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )


def test_graphics_switched_off_are_told_and_leave_no_file(tmp_path):
    done = draw_elsewhere(tmp_path, MUJOCO_GL="disable")
    assert done.returncode == 7, done.stderr
    assert "MUJOCO_GL=disable" in done.stdout
    assert done.stdout.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


def test_without_drivers_it_says_what_to_install_and_leaves_no_file(tmp_path):
    # No vendor's EGL and a PyOpenGL that is held to it: a machine without drivers.
    done = draw_elsewhere(
        tmp_path, __EGL_VENDOR_LIBRARY_FILENAMES=os.devnull, PYOPENGL_PLATFORM="egl"
    )
    assert done.returncode == 7, done.stderr
    assert "libegl1 libgl1-mesa-dri" in done.stdout
    assert "libosmesa6" in done.stdout
    assert done.stdout.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


@pytest.mark.usefixtures("can_draw")
def test_the_backend_is_found_after_mujoco_was_imported_without_one(tmp_path):
    done = draw_elsewhere(tmp_path)
    assert done.returncode == 0, done.stdout + done.stderr
    assert [p.name for p in tmp_path.iterdir()] == ["clip.mp4"]
