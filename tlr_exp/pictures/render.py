"""Pictures of the robot from saved states: frames and keyframe strips.

Nothing here runs while the robot moves: a picture needs the states alone, so that a machine
without graphics trains as well as any other and only its pictures are missing.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from tlr_exp.motion.checks import ROOT_QUAT
from tlr_exp.motion.quaternions import heading
from tlr_exp.pictures.studio import QUALITIES, Studio
from tlr_exp.robot.model import Robot

_INK = (25, 30, 40)


@dataclass(frozen=True)
class Camera:
    """A camera that follows the pelvis.

    ``azimuth_deg`` is relative to where the robot faces in the first frame: 180 looks it in the
    face, 0 at its back, 90 at its right side. ``smoothing_frames``: width of the window (standard
    deviation) over which the pelvis' path is smoothed; below 0.1 it is followed exactly.
    """

    azimuth_deg: float = 150.0
    elevation_deg: float = -10.0
    distance_m: float = 2.5
    smoothing_frames: float = 12.0


def render_frames(
    robot: Robot,
    qpos: np.ndarray,
    ghost_qpos: np.ndarray | None = None,
    *,
    width: int = 640,
    height: int = 480,
    camera: Camera | None = None,
    lookat: np.ndarray | None = None,
    captions: Sequence[str] | None = None,
    quality: str = "fast",
) -> Iterator[np.ndarray]:
    """Draw saved states one after another.

    Args:
        robot: from ``build_robot(visuals=True)``; without meshes its collision shapes are drawn.
        qpos: generalised positions [T, 30] (m, wxyz quaternion, rad).
        ghost_qpos: the reference, drawn translucent over the robot [T, 30].
        width, height: of a frame, pixels.
        camera: where it looks from.
        lookat: the point in the middle of each frame [T, 3], m; the smoothed pelvis by default.
        captions: one text a frame, written in the upper left corner; may have several lines.
        quality: ``fast`` (videos) or ``full`` (pictures for print).

    Returns:
        An iterator of T frames, uint8 [height, width, 3]. It holds the graphics context until it
        is exhausted or closed.

    Raises:
        GraphicsUnavailable: nothing can be drawn on this machine.
        ValueError: arrays of the wrong shape or with values that are not finite; an unknown
            quality.
    """
    camera = camera or Camera()
    if quality not in QUALITIES:
        raise ValueError(f"quality is {quality!r}; allowed are {', '.join(QUALITIES)}")
    qpos = _checked("qpos", qpos, (len(qpos), robot.model.nq))
    if ghost_qpos is not None:
        ghost_qpos = _checked("ghost_qpos", ghost_qpos, qpos.shape)
    path = follow_pelvis(qpos, camera.smoothing_frames) if lookat is None else lookat
    path = _checked("lookat", path, (len(qpos), 3))
    if captions is not None and len(captions) != len(qpos):
        raise ValueError(f"{len(captions)} captions for {len(qpos)} frames")
    studio = Studio(
        robot.model,
        width,
        height,
        azimuth_deg=math.degrees(heading(qpos[0, ROOT_QUAT])) + camera.azimuth_deg,
        elevation_deg=camera.elevation_deg,
        distance_m=camera.distance_m,
        quality=QUALITIES[quality],
    )

    def frames() -> Iterator[np.ndarray]:
        try:
            for i in range(len(qpos)):
                ghost = None if ghost_qpos is None else ghost_qpos[i]
                frame = studio.frame(qpos[i], ghost, path[i])
                yield frame if captions is None else caption(frame, captions[i])
        finally:
            studio.close()

    return frames()


def keyframe_strip(
    robot: Robot,
    qpos: np.ndarray,
    labels: Sequence[str],
    *,
    width: int = 320,
    height: int = 400,
    camera: Camera | None = None,
    lookat: np.ndarray | None = None,
    quality: str = "full",
) -> np.ndarray:
    """Pictures of some moments side by side, each with its label above.

    Args:
        qpos: the states of the moments [n, 30].
        labels: one for each of them.
        width, height: of one picture, pixels.
        robot, camera, lookat, quality: see ``render_frames``.

    Returns:
        uint8 [height, width, 3] of the whole strip.

    Raises:
        GraphicsUnavailable, ValueError: as ``render_frames``; labels of another number.
    """
    if len(labels) != len(qpos):
        raise ValueError(f"{len(labels)} labels for {len(qpos)} pictures")
    pictures = render_frames(
        robot, qpos, width=width, height=height, camera=camera, lookat=lookat, quality=quality
    )
    strip = np.concatenate(list(pictures), axis=1)
    size = max(10, height // 20)
    page = Image.new("RGB", (strip.shape[1], 2 * size + height), "white")
    page.paste(Image.fromarray(strip), (0, 2 * size))
    draw, font = ImageDraw.Draw(page), ImageFont.load_default(size)
    for i, label in enumerate(labels):
        draw.text(((i + 0.5) * width, size), label, _INK, font, anchor="mm")
    return np.asarray(page)


def follow_pelvis(qpos: np.ndarray, smoothing_frames: float) -> np.ndarray:
    """The pelvis' path [T, 3] in m, smoothed by a Gaussian window that reflects at both ends."""
    path = np.array(qpos[:, :3], dtype=np.float64)
    if smoothing_frames < 0.1 or len(path) < 2:
        return path
    reach = min(int(np.ceil(3 * smoothing_frames)), len(path) - 1)
    window = np.exp(-0.5 * (np.arange(-reach, reach + 1) / smoothing_frames) ** 2)
    padded = np.pad(path, ((reach, reach), (0, 0)), mode="reflect", reflect_type="odd")
    columns = [np.convolve(padded[:, i], window / window.sum(), mode="valid") for i in range(3)]
    return np.stack(columns, axis=1)


def caption(frame: np.ndarray, text: str) -> np.ndarray:
    """Write a text into the upper left corner of a frame, uint8 [height, width, 3]."""
    image = Image.fromarray(frame)
    size = max(10, frame.shape[0] // 26)
    ImageDraw.Draw(image).text(
        (size * 0.7, size * 0.6), text, fill=_INK, font=ImageFont.load_default(size)
    )
    return np.asarray(image)


def _checked(name: str, array: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    array = np.asarray(array, dtype=np.float64)
    if array.shape != shape or len(array) == 0:
        raise ValueError(f"{name} has the shape {array.shape}, expected {shape}, at least one row")
    bad = np.flatnonzero(~np.isfinite(array).all(axis=1))
    if len(bad):
        raise ValueError(f"{name}: frame {bad[0]} holds values that are not finite")
    return array
