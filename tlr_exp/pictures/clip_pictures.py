"""A clip as a video and as a strip of keyframes, the camera going along."""

from collections.abc import Callable
from pathlib import Path

import numpy as np

from tlr_exp.motion.clip import MotionClip
from tlr_exp.pictures.media import write_image, write_video
from tlr_exp.pictures.render import Camera, follow_pelvis, keyframe_strip, render_frames
from tlr_exp.robot.model import Robot

FRAME_RATE_HZ = 25.0
# MuJoCo's camera sees this angle from top to bottom; a body reaches so far around its origin.
FIELD_DEG, BODY_M, NEAREST_M = 45.0, 0.15, 2.5
# The camera follows the pelvis over the floor, and hardly up and down, so that jumps show.
FOLLOW_S, FOLLOW_HEIGHT_S = 0.4, 2.0


def film_clip(
    path: str | Path,
    robot: Robot,
    clip: MotionClip,
    name: str,
    *,
    width: int = 480,
    height: int = 360,
    frame_rate_hz: float = FRAME_RATE_HZ,
    camera: Camera | None = None,
    quality: str = "fast",
    drawn: Callable[[int, int], None] | None = None,
) -> Path:
    """Write a clip as an MP4 that runs in real time, with time and phase written in.

    Args:
        path: the file; its folder must exist.
        robot: from ``build_robot(visuals=True)``.
        clip: the motion.
        name: written into the first line.
        width, height, camera, quality: as ``render_frames``.
        frame_rate_hz: of the video, about: whole frames of the clip are left out.
        drawn: told after each frame how many there are, and of how many.

    Raises:
        GraphicsUnavailable: nothing can be drawn on this machine; no file is left.
        ValueError: the frame rate is not positive; as ``render_frames``.
        StorageError: the file cannot be written.
    """
    shown = shown_frames(clip, frame_rate_hz)
    path_of_camera = camera_path(clip)
    if camera is None:
        camera = Camera(distance_m=fitting_distance(clip, path_of_camera, width / height))
    frames = render_frames(
        robot,
        clip.qpos[shown],
        width=width,
        height=height,
        camera=camera,
        lookat=path_of_camera[shown],
        captions=[f"{name}\n{moment(clip, t)}" for t in shown],
        quality=quality,
    )

    def counted():
        for number, frame in enumerate(frames, start=1):
            yield frame
            if drawn is not None:
                drawn(number, len(shown))

    return write_video(path, counted(), clip.fps / (shown[1] - shown[0]))


def strip_of_clip(
    path: str | Path,
    robot: Robot,
    clip: MotionClip,
    times_s: np.ndarray,
    *,
    camera: Camera | None = None,
    width: int = 320,
    height: int = 400,
    quality: str = "full",
) -> Path:
    """Write a strip of pictures as a PNG, one column for each of ``times_s`` [n].

    Raises:
        ValueError: a time outside the clip.
        GraphicsUnavailable, StorageError: as ``film_clip``.
    """
    frames = frames_at(clip, times_s)
    # A picture of its own stands still: what is in the middle of it is the pelvis.
    lookat = np.column_stack([clip.qpos[:, :2], camera_path(clip)[:, 2]])
    if camera is None:
        camera = Camera(distance_m=fitting_distance(clip, lookat, width / height))
    strip = keyframe_strip(
        robot,
        clip.qpos[frames],
        [f"{t / clip.fps:.2f} s" for t in frames],
        width=width,
        height=height,
        camera=camera,
        lookat=lookat[frames],
        quality=quality,
    )
    return write_image(path, strip)


def shown_frames(clip: MotionClip, frame_rate_hz: float) -> np.ndarray:
    """Which frames of a clip a video of about ``frame_rate_hz`` shows, at least two.

    Raises:
        ValueError: the rate is not positive.
    """
    if not (np.isfinite(frame_rate_hz) and frame_rate_hz > 0):
        raise ValueError(f"the video's frame rate is {frame_rate_hz:g}; it must be positive")
    stride = min(max(1, round(clip.fps / frame_rate_hz)), clip.num_frames - 1)
    return np.arange(0, clip.num_frames, stride)


def frames_at(clip: MotionClip, times_s: np.ndarray) -> np.ndarray:
    """The frames [n] nearest to ``times_s`` [n].

    Raises:
        ValueError: a time is not within the clip.
    """
    within = (times_s >= 0) & (times_s <= clip.duration_s + 0.5 / clip.fps)
    if not within.all():
        wrong = times_s[~within][0]
        raise ValueError(f"{wrong:g} s is not within the clip of {clip.duration_s:.2f} s")
    return np.minimum(np.rint(times_s * clip.fps).astype(int), clip.num_frames - 1)


def camera_path(clip: MotionClip) -> np.ndarray:
    """The points [T, 3] in m at which a camera looks."""
    path = follow_pelvis(clip.qpos, FOLLOW_S * clip.fps)
    path[:, 2] = follow_pelvis(clip.qpos, FOLLOW_HEIGHT_S * clip.fps)[:, 2]
    return path


def fitting_distance(clip: MotionClip, lookat: np.ndarray, aspect: float) -> float:
    """How far in m a camera must be to have all of the robot in all its pictures.

    Args:
        clip: the motion.
        lookat: the point in the middle of each frame's picture [T, 3].
        aspect: width by height of a picture.
    """
    away = clip.body_pos_w - lookat[:, None]
    up = np.abs(away[..., 2]).max() + BODY_M
    aside = np.linalg.norm(away[..., :2], axis=-1).max() + BODY_M
    return max(NEAREST_M, float(max(up, aside / aspect) / np.tan(np.radians(FIELD_DEG / 2))))


def moment(clip: MotionClip, frame: int) -> str:
    """Time and phase of a frame in words."""
    return (
        f"{frame / clip.fps:.2f} s of {clip.duration_s:.2f} s   "
        f"phase {frame / (clip.num_frames - 1):.2f}"
    )
